/* What the emulator can do that HDAPI cannot: choose the device and the hand, script motions, break things, and run in
 * virtual time. SI units throughout, in the device's axes: x to the right, y up, z towards the user.
 *
 * Programs that include nothing but HD/hd.h run on the emulator unchanged. All calls may come from any thread, at any
 * time after hdInitDevice of the device, unless they say otherwise.
 */
#ifndef HD_EMULATOR_H
#define HD_EMULATOR_H

#include <HD/hd.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Time ---- */

/* Everything as at the program's start: no scheduler, no devices, no errors, real time. Not from a callback. */
HDAPI void hd_emulator_reset(void);

/* 1: the scheduler has no thread, and time passes only in hd_emulator_advance: same program, same numbers. Before
 * hdStartScheduler. */
HDAPI void hd_emulator_use_virtual_time(int on);

/* Virtual time passes; the callbacks of as many ticks as fit run on the calling thread. Returns the ticks that ran. */
HDAPI uint64_t hd_emulator_advance(double seconds);

/* Seconds since hdStartScheduler, of the scheduler's newest tick. */
HDAPI double hd_emulator_time_s(void);

/* How the scheduler's thread waits in real time: it sleeps until this long before a deadline and spins the rest (default
 * 50e-6; 0 only sleeps). */
HDAPI void hd_emulator_set_spin(double seconds);

/* The scheduler's own periods, from the start of a tick to that of the next. */
typedef struct {
    uint64_t count;
    double p50_s, p99_s, p999_s, max_s;
    uint64_t over_1_1_ms, over_2_ms, longest_run_over_1_1_ms;
} hd_emulator_periods;
HDAPI void hd_emulator_get_periods(hd_emulator_periods *periods);

/* ---- Device and hand ---- */

/* A device and the hand that holds it: one mass on the hand's spring and damper, whose other end the script moves. */
typedef struct {
    double device_mass_kg;      /* 0.045 */
    double viscous_n_s_m;       /* 0.02 */
    double coulomb_n;           /* 0.26 */
    double encoder_step_m;      /* 0.055e-3; 0 reads the position as it is */
    double velocity_window_s;   /* 0.010: velocity is the difference of positions this far apart */
    double hand_mass_kg;        /* 0.15 */
    double hand_stiffness_n_m;  /* 300 */
    double hand_damping_n_s_m;  /* 5 */
    double max_force_n;         /* 3.3 */
    double continuous_force_n;  /* 0.88 */
    double max_speed_m_s;       /* 1.5: above it HD_EXCEEDED_MAX_VELOCITY */
    double watchdog_s;          /* 0.020: without a frame for so long the motors go off */
    int output_dof;             /* 3; 6 takes gimbal torques */
    int calibration_style;      /* HD_CALIBRATION_INKWELL */
} hd_emulator_device;
HDAPI void hd_emulator_device_init(hd_emulator_device *device);
HDAPI void hd_emulator_set_device(HHD hHD, const hd_emulator_device *device);
/* What devices that are opened from now on are; before, they are what hd_emulator_device_init says. */
HDAPI void hd_emulator_set_next_device(const hd_emulator_device *device);

/* Where the hand wants to be at a time. angles_rad are yaw about y, pitch about the turned x, roll about the stylus (z);
 * the stylus follows them at once. Called on the scheduler's thread, many times a tick; it must not call HDAPI. */
typedef struct {
    double position_m[3];
    double velocity_m_s[3];
    double angles_rad[3];
} hd_emulator_target;
typedef void (*hd_emulator_hand_fn)(void *user, double time_s, hd_emulator_target *target);
HDAPI void hd_emulator_set_hand(HHD hHD, hd_emulator_hand_fn hand, void *user);

/* Hands that are ready made. */
enum {
    HD_EMULATOR_HOLD,    /* stays at start_m */
    HD_EMULATOR_PRESS,   /* goes travel_m along direction, holds for hold_s, and comes back; again and again */
    HD_EMULATOR_DRAG,    /* as PRESS, then drag_m across before it comes back */
    HD_EMULATOR_TREMOR,  /* as PRESS, with a sine of amplitude_m at frequency_hz added along direction */
    HD_EMULATOR_RANDOM,  /* wanders around start_m within amplitude_m: sines of three rates an axis, drawn from seed */
    HD_EMULATOR_LET_GO   /* no hand: the device is alone */
};
typedef struct {
    int kind;
    double start_m[3];
    double direction[3]; /* need not be of unit length */
    double travel_m;
    double speed_m_s;
    double hold_s;
    double drag_m[3];
    double amplitude_m;
    double frequency_hz;
    uint64_t seed;
    double wait_s;       /* PRESS, DRAG, TREMOR: begins at this time of hd_emulator_time_s (default 0) */
} hd_emulator_motion;
HDAPI void hd_emulator_motion_init(hd_emulator_motion *motion, int kind);
HDAPI void hd_emulator_set_motion(HHD hHD, const hd_emulator_motion *motion);

/* A recorded hand: lines of time_s,x_m,y_m,z_m, with straight lines between. Returns 1, or 0 where the file cannot be
 * read, has a line that is none, or times that do not grow. */
HDAPI int hd_emulator_load_motion(HHD hHD, const char *path);

/* Puts the mass somewhere, at rest. */
HDAPI void hd_emulator_place(HHD hHD, const double *position_m);

/* What really happens, without encoders and filters. */
typedef struct {
    double position_m[3];
    double velocity_m_s[3];
    double target_m[3];
    double force_n[3];      /* of the motors, after all limits */
    double torque_n_m[3];   /* gimbal torques, after all limits */
    uint64_t frames;
} hd_emulator_truth;
HDAPI void hd_emulator_get_truth(HHD hHD, hd_emulator_truth *truth);

/* ---- Faults ---- */

/* The next `ticks` frames report positions, velocities and transforms that are no numbers. */
HDAPI void hd_emulator_inject_nan(HHD hHD, unsigned ticks);
/* From the next frame on positions are reported this far off; zero mends it. */
HDAPI void hd_emulator_inject_jump(HHD hHD, const double *offset_m);
/* The next `ticks` frames raise this error, such as HD_COMM_ERROR. */
HDAPI void hd_emulator_inject_error(HHD hHD, HDerror error, unsigned ticks);
/* HD_CALIBRATION_NEEDS_UPDATE or HD_CALIBRATION_NEEDS_MANUAL_INPUT, until hdUpdateCalibration or HD_CALIBRATION_OK here. */
HDAPI void hd_emulator_set_calibration(HHD hHD, HDenum state);
/* Buttons held down, as HD_DEVICE_BUTTON_ bits. */
HDAPI void hd_emulator_set_buttons(HHD hHD, int buttons);
/* Motor temperature from 0 to 1; from 0.9 on frames raise HD_WARM_MOTORS. */
HDAPI void hd_emulator_set_temperature(HHD hHD, double temperature);
/* The scheduler does nothing for a while, once, from its next tick on. */
HDAPI void hd_emulator_stall(double seconds);

#ifdef __cplusplus
}
#endif

#endif
