/* A servo bridge between palpate and OpenHaptics: a device opened through HDAPI feels a plp_tool.
 *
 *   plp_hd_desc how = plp_hd_desc_default();          // the default device, at the world's origin, same size
 *   plp_haptic_desc limits = plp_haptic_desc_default();
 *   plp_hd *hand;
 *   plp_hd_open(&how, &hand);
 *   plp_hd_haptic(hand, &limits);                     // what this device bears, in the world's units
 *   probe.haptic = &limits;                           // a plp_tool_desc
 *   plp_tool_create(sim, &probe, &tool);
 *   plp_hd_attach(hand, tool);
 *   plp_hd_start(hand);                               // from now on the device pushes back
 *   plp_sim_start(sim, NULL);                         // and the simulation steps on a thread of its own
 *   ...
 *   plp_hd_close(hand);                               // before or after the tool, the simulation and the model
 *
 * Between open and close nothing that goes wrong stops the program: it stops the force. plp_hd_get_state says what
 * happened. SI units; device frame and world frame are right-handed; statuses are palpate's, and plp_hd_last_error()
 * has a sentence for those below 0. Functions are marked
 *
 *   @thread host    from one thread at a time for each port, not from a servo callback
 *   @thread any     from any thread
 *   @rt             no lock of the bridge, no allocation, bounded time: made for the servo thread
 *
 * README.md, beside this header, has the whole story on one page.
 */
#ifndef PALPATE_HDAPI_H
#define PALPATE_HDAPI_H

#include <palpate/palpate.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A device that is open. At most PLP_HD_PORTS at once. */
typedef struct plp_hd plp_hd;
#define PLP_HD_PORTS 8

/* Why there is no force, or less: bits of plp_hd_tick.faults. What the bridge finds is to the tool a dead-man switch that
 * was let go: no force at once, and none until the cause is gone and the tool has left the tissue, from where it comes back
 * slowly. What the tool finds (TISSUE, STALE) goes as plp_tool_exchange says; plp_hd_tick.servo_flags has all it says. */
#define PLP_HD_FAULT_NOT_FINITE 1u   /* the device reported a number that is none, or a transform without rotation */
#define PLP_HD_FAULT_JUMP 2u         /* it moved faster than can be; the tool is led there slowly */
#define PLP_HD_FAULT_DEVICE 4u       /* it failed or does not answer; stays until plp_hd_resume */
#define PLP_HD_FAULT_LIMIT 8u        /* HDAPI found force or speed too high, or motors warm */
#define PLP_HD_FAULT_CALIBRATION 16u /* it does not know where it is; see plp_hd_calibrate */
#define PLP_HD_FAULT_TISSUE 32u      /* the simulation is gone or failed, or the tool was busy: see plp_hd_tick.status */
#define PLP_HD_FAULT_STALE 64u       /* the simulation has not stepped for so long that the force decays or is gone */
#define PLP_HD_FAULT_BUSY 128u       /* two threads were in plp_hd_run_tick at once; the second did nothing */
#define PLP_HD_FAULT_FRAME 256u      /* HDAPI was used against its rules, such as two frames in one tick */
#define PLP_HD_FAULT_SERVO 512u      /* started, and no tick for 50 ms: only plp_hd_get_state can say so */
#define PLP_HD_FAULT_COUNT 10

/* A bit of plp_hd_desc.flags: you own the scheduler. plp_hd_start then schedules nothing, and your callback calls
 * plp_hd_run_tick. */
#define PLP_HD_HOST_SERVO 1u

/* How the device's force follows from the tissue's when the mapping scales. */
#define PLP_HD_FORCE_BY_WORK 0u /* times scale: device and tool do the same work, so that scaling adds no energy */
#define PLP_HD_FORCE_AS_FELT 1u /* the same newtons: device stiffness grows with the scale */

/* Where the device's workspace lies in the world: world = base applied to (scale * device). */
typedef struct {
    plp_pose base;       /* the device's origin and axes (x to the right, y up, z towards the user) in the world */
    double scale;        /* world metres for each metre of the device, 1e-3 to 1e3 */
    uint32_t force_rule; /* PLP_HD_FORCE_BY_WORK or PLP_HD_FORCE_AS_FELT */
    uint32_t reserved;   /* 0 */
} plp_hd_mapping;

/* One tick of the servo. */
typedef struct {
    double time_s;              /* the bridge's clock at the start of the tick */
    double period_s;            /* since the tick before; 0 in the first */
    plp_motion motion;          /* the device, world frame, as the tool was told */
    plp_motion tool;            /* the tool that hangs on it, world frame */
    double device_position_m[3]; /* device frame */
    double force_n[3];          /* what the tool gives the device, world frame */
    double torque_n_m[3];
    double device_force_n[3];   /* written to the device, device frame */
    double gimbal_torque_n_m[3]; /* written to the gimbal's motors: yaw, pitch, roll */
    double age_s;               /* how long ago the step arrived that this force comes from; negative before the first */
    double latency_s;           /* how old the pose was that it was computed with, when it arrived */
    uint64_t tick;              /* counts from 1 */
    uint64_t sequence;          /* of the simulation's step, as in plp_force */
    uint32_t faults;            /* PLP_HD_FAULT_, or'ed */
    uint32_t buttons;           /* HD_DEVICE_BUTTON_, or'ed */
    uint32_t servo_flags;       /* PLP_SERVO_, or'ed: what was done to the force; 0 without a tool */
    uint32_t hd_error;          /* the first HDAPI error of the tick, HD_SUCCESS without */
    plp_status status;          /* what the tool answered; PLP_NOTHING without one */
    uint32_t reserved;          /* always 0 */
} plp_hd_tick;

/* Called at the end of each tick on the servo thread: no lock, no allocation, no throw. */
typedef void (*plp_hd_tick_fn)(void *user, const plp_hd_tick *tick);
/* Seconds that only grow. */
typedef double (*plp_hd_clock_fn)(void *user);

/* How to open a device. Fill it with plp_hd_desc_init (or plp_hd_desc_default), then change what you need. */
typedef struct {
    uint32_t struct_size;
    uint32_t flags;          /* PLP_HD_HOST_SERVO */
    const char *device_name; /* as HDAPI's configuration names it; NULL (default) takes the default device */
    plp_hd_mapping mapping;
    double max_speed_m_s;    /* of the device; above it a move is a jump (default 2) */
    plp_hd_tick_fn on_tick;  /* NULL (default) for none */
    void *on_tick_user;
    plp_hd_clock_fn clock;   /* NULL (default) takes the steady clock; virtual time in tests */
    void *clock_user;
} plp_hd_desc;

/* What the device says of itself. */
typedef struct {
    char model[64];
    char serial[64];
    double max_force_n;
    double continuous_force_n;
    double max_stiffness_n_m;
    double max_damping_n_s_m;
    double max_torque_n_m;   /* of the gimbal; 0, as the three below it, where it renders none or HDAPI does not say */
    double continuous_torque_n_m;
    double max_stiffness_n_m_rad;
    double max_damping_n_m_s_rad;
    double servo_rate_hz;    /* of HDAPI's scheduler */
    double reach_min_m[3];   /* of the whole workspace, device frame */
    double reach_max_m[3];
    double usable_min_m[3];  /* of the part where forces are good */
    double usable_max_m[3];
    int32_t output_dof;      /* 3: force; 6: force and torque */
    int32_t calibration_style;
} plp_hd_info;

/* How a port is doing. */
typedef struct {
    plp_hd_tick last;                          /* the newest tick */
    double idle_s;                             /* since it began */
    uint32_t faults;                           /* its faults, and PLP_HD_FAULT_SERVO */
    uint32_t faults_ever;                      /* since open */
    uint64_t fault_ticks[PLP_HD_FAULT_COUNT];  /* ticks with each fault, by bit; calls for BUSY */
    uint32_t last_hd_error;                    /* the newest HDAPI error of this device, HD_SUCCESS before the first */
    uint32_t is_started;                       /* 0 or 1 */
} plp_hd_state;

#define PLP_HD_PERIOD_BUCKETS 501
/* Times of ticks. Quantiles are the ends of buckets of 10 us. */
typedef struct {
    uint64_t ticks;
    double p50_s, p99_s, p999_s, max_s;        /* from tick to tick; max_s is the longest gap */
    uint64_t over_1_1_ms, over_2_ms;
    uint64_t longest_run_over_1_1_ms;
    double work_p50_s, work_p99_s, work_max_s; /* within plp_hd_run_tick */
    double age_p50_s, age_p99_s, age_max_s;    /* of the force, while there was one */
    uint64_t periods[PLP_HD_PERIOD_BUCKETS];   /* i * 10 us and more; the last has all from 5 ms */
} plp_hd_statistics;

/* Fills a desc with defaults. @thread any */
plp_status plp_hd_desc_init(plp_hd_desc *desc, uint32_t desc_size);

/* Opens a device, calibrates it where a call can, and asks what it is. Its force stays off until plp_hd_start.
 * PLP_ERR_DEVICE where HDAPI cannot; PLP_ERR_LIMIT where PLP_HD_PORTS are open. desc may be NULL. @thread host */
plp_status plp_hd_open(const plp_hd_desc *desc, plp_hd **port);

/* Stops the port and gives its device back. The port is gone. NULL is fine. @thread host */
plp_status plp_hd_close(plp_hd *port);

/* What the device says of itself. info_size is sizeof(plp_hd_info). @thread any */
plp_status plp_hd_get_info(plp_hd *port, plp_hd_info *info, uint32_t info_size);

/* Says what the device bears, for plp_tool_desc.haptic: what HDAPI tells of it, in the world's units. A world that is s
 * times the device's size has s times its speed and reach; and where tissue's newtons are multiplied by k on their way to
 * the device (s under PLP_HD_FORCE_BY_WORK, 1 under PLP_HD_FORCE_AS_FELT), forces and their slew are 1/k, stiffness and
 * damping 1/(k s) of the device's. What HDAPI does not name is as plp_haptic_desc_init has it. Window, coupling and
 * PLP_HAPTIC_PASSIVE stay as they are in the desc: fill it with plp_haptic_desc_init first. Map the workspace before.
 * @thread host */
plp_status plp_hd_haptic(plp_hd *port, plp_haptic_desc *haptic);

/* Gives the port a tool that was made with plp_tool_desc.haptic, or none (NULL). When it returns, the servo has let go of
 * the old one, which may then be destroyed. PLP_ERR_STATE for a tool without a haptic device. @thread host */
plp_status plp_hd_attach(plp_hd *port, plp_tool *tool);

/* Moves the workspace. With another scale or force rule make the tool anew, by plp_hd_haptic. PLP_ERR_STATE while started.
 * @thread host */
plp_status plp_hd_map(plp_hd *port, const plp_hd_mapping *mapping);

/* Enables the force and schedules the servo callback; starts HDAPI's scheduler where no port has. @thread host */
plp_status plp_hd_start(plp_hd *port);

/* The force is zero and the callback gone when it returns; the scheduler stops with the last port that it was started
 * for. @thread host */
plp_status plp_hd_stop(plp_hd *port);

/* Calibrates a device that asks for it. PLP_ERR_STATE where it needs a hand: put the stylus into its inkwell.
 * @thread host */
plp_status plp_hd_calibrate(plp_hd *port);

/* After PLP_HD_FAULT_DEVICE: the device answers again, let the force come back. @thread host */
plp_status plp_hd_resume(plp_hd *port);

/* One tick, for hosts with a scheduler callback of their own (PLP_HD_HOST_SERVO): one frame, in which the device is
 * read, the tool is moved, and the force is written. PLP_OK, or PLP_ERR_BUSY to a second thread, PLP_ERR_STATE before
 * plp_hd_start. @thread any @rt */
plp_status plp_hd_run_tick(plp_hd *port);

/* How the port is doing. state_size is sizeof(plp_hd_state). @thread any */
plp_status plp_hd_get_state(plp_hd *port, plp_hd_state *state, uint32_t state_size);

/* Times since plp_hd_start or plp_hd_reset_statistics. statistics_size is sizeof(plp_hd_statistics). @thread any */
plp_status plp_hd_get_statistics(plp_hd *port, plp_hd_statistics *statistics, uint32_t statistics_size);

/* Counts times from none on. @thread any */
plp_status plp_hd_reset_statistics(plp_hd *port);

/* A word for one fault bit, such as "jump". Static memory. @thread any */
const char *plp_hd_fault_name(uint32_t fault);

/* What went wrong in the last failing call on this thread, but for plp_hd_run_tick. Never NULL. @thread any */
const char *plp_hd_last_error(void);

#ifdef __cplusplus
}
#endif

/* The default device at the world's origin, same size. */
static inline plp_hd_desc plp_hd_desc_default(void) {
    plp_hd_desc desc;
    plp_hd_desc_init(&desc, (uint32_t)sizeof desc);
    return desc;
}

#endif
