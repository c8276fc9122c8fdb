// A hand at a haptic device feels a chest: opens the device through HDAPI, puts its workspace on the skin, lets the servo
// run at 1 kHz while the simulation steps on a thread of its own, and says how well both kept time.
#include "anatomy.h"
#include "drive.h"
#include "report.h"

int main(int argc, char **argv) {
    Options options;
    if (!options.parse(argc, argv) || (options.is_virtual && !IS_EMULATED)) {
        std::fputs(Options::HELP, stderr);
        return 2;
    }
    std::setvbuf(stdout, nullptr, _IOLBF, BUFSIZ); // events are read as they come, also through a pipe
    check(plp_check_abi());
    if (options.is_virtual) use_virtual_time();

    // The tissue.
    plp_model *model = build(options);
    plp_sim_desc settings = plp_sim_desc_default();
    const unsigned cores = std::thread::hardware_concurrency();
    settings.threads = options.threads > 0 ? options.threads : cores > 1 ? cores - 1 : 1;
    plp_sim *sim = nullptr;
    check(plp_sim_create(model, &settings, &sim));

    // The device, with its workspace before the skin.
    Record record(static_cast<std::size_t>(std::ceil(1.05 * 1000.0 * options.seconds)));
    const plp_pick skin = find_skin(model, sim, options);
    plp_hd_desc how = plp_hd_desc_default();
    how.device_name = options.device.empty() ? nullptr : options.device.c_str();
    how.mapping = map_workspace(skin, options.scale);
    how.on_tick = Record::on_tick;
    how.on_tick_user = &record;
    if (options.is_virtual) how.clock = emulated_time;
    plp_hd *port = nullptr;
    plp_hd_info device;
    check_hd(plp_hd_open(&how, &port));
    check_hd(plp_hd_get_info(port, &device, sizeof device));
    record.max_force_n = device.max_force_n;
    if (!script_hand(options)) {
        std::fprintf(stderr, "%s is no motion\n", options.motion.c_str());
        return 2;
    }

    // A ball that the device can hold.
    plp_haptic_desc limits = plp_haptic_desc_default();
    check_hd(plp_hd_haptic(port, &limits));
    limits.coupling = options.is_direct ? PLP_COUPLING_DIRECT : PLP_COUPLING_VIRTUAL;
    plp_tool_part ball = plp_sphere(RADIUS_M);
    plp_tool_desc probe = plp_tool_desc_default();
    probe.parts = &ball;
    probe.part_count = 1;
    probe.haptic = &limits;
    plp_tool *tool = nullptr;
    check(plp_tool_create(sim, &probe, &tool));

    plp_material pressed;
    check(plp_model_get_material(model, skin.material, &pressed));
    std::printf("device               %s, %.1f N at most\n", device.model, device.max_force_n);
    std::printf("presses              %s of %.1f kPa at (%.0f, %.0f, %.0f) mm\n", pressed.name, 1e-3 * pressed.young_pa,
                1e3 * skin.point_m[0], 1e3 * skin.point_m[1], 1e3 * skin.point_m[2]);
    std::printf("driver               %s\n", drive_name(options));

    // Touch.
    check_hd(plp_hd_attach(port, tool));
    check_hd(plp_hd_start(port));
    const auto start = std::chrono::steady_clock::now();
    let_touch(options, sim, settings.step_s, port);
    const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();

    report_servo(port, tool, record, wall_s);
    report_simulation(sim, wall_s);
    report_faults(port);
    const bool is_written = record.write(options.csv);
    if (!is_written) std::fprintf(stderr, "%s cannot be written\n", options.csv.c_str());

    plp_hd_close(port);
    plp_tool_destroy(tool);
    plp_sim_destroy(sim);
    plp_model_destroy(model);
    return is_written ? 0 : 1;
}
