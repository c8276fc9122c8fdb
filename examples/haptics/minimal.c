/* The servo callback of a host that calls HDAPI itself, in 15 lines, and what must be around it: a ball before the generated
 * chest, and the simulation's own thread. HDAPI has millimetres, palpate metres; the device's axes are the world's here, its
 * origin lies 5 mm before the skin. plp_tool_exchange bounds the force whatever happens to hand, device and
 * simulation. The bridge in bindings/haptics adds mapping and answers to the device's own faults: take that one for a hand
 * at a real device. */
#include <HD/hd.h>
#include <palpate/palpate.h>
#include <stdio.h>
#include <threads.h>
#include <time.h>
#ifdef PALPATE_HD_EMULATOR
#include "hd_emulator.h"
#endif

/* A step of this clock backwards, which can happen, takes the force away for a while; a monotonic one is better. */
static double now_s(void) {
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static HDCallbackCode HDCALLBACK servo(void *user) {
    double at_mm[3] = {0}, v_mm_s[3] = {0};
    plp_servo felt;
    hdBeginFrame(hdGetCurrentDevice());
    hdGetDoublev(HD_CURRENT_POSITION, at_mm);
    hdGetDoublev(HD_CURRENT_VELOCITY, v_mm_s);
    plp_motion motion = plp_motion_at(1e-3 * at_mm[0], 1e-3 * at_mm[1] + 0.12, 1e-3 * at_mm[2] - 0.06);
    for (int i = 0; i < 3; ++i) motion.linear_m_s[i] = 1e-3 * v_mm_s[i];
    plp_haptic_state hand = {motion, now_s(), 0, 0};
    plp_tool_exchange((plp_tool *)user, &hand, &felt); /* whatever it answers, the force is one that may be felt */
    hdSetDoublev(HD_CURRENT_FORCE, felt.force_n);
    hdEndFrame(hdGetCurrentDevice());
    return HD_CALLBACK_CONTINUE;
}

int main(void) {
    plp_model_desc chest = plp_model_desc_default();
    plp_tool_part ball = plp_sphere(0.010);
    plp_tool_desc probe = plp_tool_desc_default();
    plp_haptic_desc touch = plp_haptic_desc_default(); /* the limits of a 3D Systems Touch */
    plp_model *model = NULL;
    plp_sim *sim = NULL;
    plp_tool *tool = NULL;
    double peak_n = 0.0;
    HHD device = hdInitDevice(HD_DEFAULT_DEVICE);
    if (HD_DEVICE_ERROR(hdGetError())) return 1;
#ifdef PALPATE_HD_EMULATOR
    hd_emulator_motion press;
    hd_emulator_motion_init(&press, HD_EMULATOR_PRESS); /* 20 mm at 50 mm/s, when the tool has engaged */
    press.wait_s = 0.7;
    press.direction[1] = -1.0;
    press.direction[2] = 0.0;
    hd_emulator_set_motion(device, &press);
#endif

    chest.cell_m = 0.012; /* coarse and soft enough for a processor to step in time */
    chest.young_cap_pa = 20e3;
    probe.parts = &ball;
    probe.part_count = 1;
    probe.haptic = &touch;
    touch.coupling = PLP_COUPLING_DIRECT; /* soft tissue of large cells; finer ones, and bone, want the default */
    if (plp_model_create(&chest, &model) < 0 || plp_sim_create(model, NULL, &sim) < 0 ||
        plp_tool_create(sim, &probe, &tool) < 0) {
        printf("%s\n", plp_last_error());
        return 1;
    }

    hdEnable(HD_FORCE_OUTPUT);
    hdEnable(HD_MAX_FORCE_CLAMPING);
    HDSchedulerHandle handle = hdScheduleAsynchronous(servo, tool, HD_MAX_SCHEDULER_PRIORITY);
    hdStartScheduler();
    plp_sim_start(sim, NULL);
    for (double end_s = now_s() + 2.2; now_s() < end_s;) { /* the rest of a program */
        const struct timespec frame = {0, 4000000};
        double force_n[3] = {0.0, 0.0, 0.0};
        thrd_sleep(&frame, NULL);
        hdGetDoublev(HD_CURRENT_FORCE, force_n);
        peak_n = force_n[1] > peak_n ? force_n[1] : peak_n;
    }
    hdStopScheduler();
    hdUnschedule(handle);
    hdDisableDevice(device);
    printf("peak force %.2f N\n", peak_n);
    plp_tool_destroy(tool);
    plp_sim_destroy(sim);
    plp_model_destroy(model);
    return 0;
}
