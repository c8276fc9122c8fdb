/* The servo callback of a host that calls HDAPI itself, in 15 lines, and what must be around it: a ball before the generated
 * chest, and a thread that steps. HDAPI has millimetres, palpate metres; the device's axes are the world's here, its origin
 * lies a few millimetres before the skin. The bridge in bindings/haptics does the same with mapping, ramps and answers to faults: take
 * that one for a hand at a real device. */
#include <HD/hd.h>
#include <palpate/palpate.h>
#include <stdio.h>
#include <time.h>
#ifdef PALPATE_HD_EMULATOR
#include "hd_emulator.h"
#endif

static HDCallbackCode HDCALLBACK servo(void *user) {
    plp_tool *tool = (plp_tool *)user;
    const double none[3] = {0.0, 0.0, 0.0};
    double at_mm[3], v_mm_s[3];
    plp_force felt;
    hdBeginFrame(hdGetCurrentDevice());
    hdGetDoublev(HD_CURRENT_POSITION, at_mm);
    hdGetDoublev(HD_CURRENT_VELOCITY, v_mm_s);
    plp_motion motion = plp_motion_at(1e-3 * at_mm[0], 1e-3 * at_mm[1] + 0.11, 1e-3 * at_mm[2] - 0.06);
    for (int i = 0; i < 3; ++i) motion.linear_m_s[i] = 1e-3 * v_mm_s[i];
    plp_status sent = plp_tool_set_pose(tool, &motion), got = plp_tool_get_force(tool, &felt);
    hdSetDoublev(HD_CURRENT_FORCE, sent == PLP_OK && got == PLP_OK ? felt.force_n : none);
    hdEndFrame(hdGetCurrentDevice());
    return HD_CALLBACK_CONTINUE;
}

static double now_s(void) {
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

int main(void) {
    plp_model_desc chest = plp_model_desc_default();
    plp_tool_part ball = plp_sphere(0.010);
    plp_tool_desc probe = plp_tool_desc_default();
    plp_model *model = NULL;
    plp_sim *sim = NULL;
    plp_tool *tool = NULL;
    double peak_n = 0.0;
    HHD device = hdInitDevice(HD_DEFAULT_DEVICE);
    if (HD_DEVICE_ERROR(hdGetError())) return 1;
#ifdef PALPATE_HD_EMULATOR
    hd_emulator_motion press;
    hd_emulator_motion_init(&press, HD_EMULATOR_PRESS); /* 20 mm at 50 mm/s */
    press.direction[1] = -1.0;
    press.direction[2] = 0.0;
    hd_emulator_set_motion(device, &press);
#endif

    chest.cell_m = 0.009; /* coarse and soft enough for a processor to step in time */
    chest.young_cap_pa = 20e3;
    probe.parts = &ball;
    probe.part_count = 1;
    if (plp_model_create(&chest, &model) < 0 || plp_sim_create(model, NULL, &sim) < 0 ||
        plp_tool_create(sim, &probe, &tool) < 0) {
        printf("%s\n", plp_last_error());
        return 1;
    }

    hdEnable(HD_FORCE_OUTPUT);
    hdEnable(HD_MAX_FORCE_CLAMPING);
    HDSchedulerHandle handle = hdScheduleAsynchronous(servo, tool, HD_MAX_SCHEDULER_PRIORITY);
    hdStartScheduler();
    for (double end_s = now_s() + 1.5; now_s() < end_s;) { /* a game has a thread for this, at the clock's pace */
        double force_n[3] = {0.0, 0.0, 0.0};
        plp_sim_step(sim);
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
