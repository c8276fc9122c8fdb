// A hand at a haptic device feels a chest: opens the device through HDAPI, puts its workspace on the skin, lets the servo
// run at 1 kHz while a thread of this program steps the tissue, and says how well both kept time.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "hand.h"
#include "options.h"
#include "palpate_hdapi.h"
#include "record.h"

namespace {

constexpr double RADIUS_M = 0.010, CLEARANCE_M = 0.010;

void check(plp_status status) {
    if (status >= 0) return;
    std::fprintf(stderr, "%s: %s\n", plp_status_name(status), plp_last_error());
    std::exit(1);
}

void check_hd(plp_status status) {
    if (status >= 0) return;
    std::fprintf(stderr, "%s: %s\n", plp_status_name(status), plp_hd_last_error());
    std::exit(1);
}

plp_model *build(const Options &options) {
    plp_model_desc anatomy = plp_model_desc_default();
    std::vector<plp_label_use> uses;
    anatomy.cell_m = options.cell_m;
    anatomy.young_cap_pa = options.young_cap_pa;
    if (!options.labels.empty()) {
        // Bone is rigid, what is not named is empty, and all faces but the front are held.
        for (std::uint32_t label = 0; label < 256; ++label) uses.push_back(plp_label_as(label, PLP_USE_EMPTY, nullptr));
        for (const std::string &use : options.uses) {
            const auto label = static_cast<std::uint32_t>(std::atoi(use.c_str())) % 256;
            const std::string name = use.substr(use.find('=') + 1);
            uses[label] = plp_label_as(label, name == "bone" ? PLP_USE_RIGID : PLP_USE_TISSUE, name.c_str());
        }
        anatomy.labels_path = options.labels.c_str();
        anatomy.uses = uses.data();
        anatomy.use_count = static_cast<std::uint32_t>(uses.size());
        anatomy.fix_faces = 63 & ~static_cast<std::uint32_t>(PLP_FACE_Y_HIGH);
    }
    plp_model *model = nullptr;
    check(plp_model_create(&anatomy, &model));
    return model;
}

/// Where a ray from the front meets the skin.
plp_pick find_skin(const plp_model *model, const plp_sim *sim) {
    plp_model_info info;
    check(plp_model_get_info(model, &info, sizeof info));
    const double *low = info.bounds_min_m, *high = info.bounds_max_m, backwards[3] = {0.0, -1.0, 0.0};
    const double eye[3] = {0.5 * (low[0] + high[0]), high[1] + 0.1, 0.75 * low[2] + 0.25 * high[2]};
    plp_pick skin;
    if (plp_sim_pick(sim, eye, backwards, &skin) != PLP_OK) {
        std::fprintf(stderr, "there is nothing to press\n");
        std::exit(1);
    }
    return skin;
}

/// The user faces the chest: away from the user (-z of the device) is into it (-y of the world), and up is its head.
/// The device's origin lies before the skin.
plp_hd_mapping map_workspace(const plp_pick &skin, double scale) {
    plp_hd_mapping mapping = plp_hd_desc_default().mapping;
    const double half = std::sqrt(0.5);
    mapping.base = plp_pose_at(skin.point_m[0], skin.point_m[1] + RADIUS_M + CLEARANCE_M * scale, skin.point_m[2]);
    // Half a turn about the line between y and z exchanges these two, and turns x round: the patient faces the user, and
    // has its right where the user has the left.
    mapping.base.rotation[0] = 0.0;
    mapping.base.rotation[1] = half;
    mapping.base.rotation[2] = half;
    mapping.base.rotation[3] = 0.0;
    mapping.scale = scale;
    return mapping;
}

/// Steps at the pace of the wall clock, and slower where a step takes longer: it never tries to catch up.
void step_in_time(plp_sim *sim, double step_s, const std::atomic<bool> &is_done) {
    using Clock = std::chrono::steady_clock;
    const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(step_s));
    auto due = Clock::now();
    while (!is_done.load()) {
        if (plp_sim_step(sim) < 0) {
            std::fprintf(stderr, "the simulation failed: %s\n", plp_last_error());
            return; // the servo lets go of the device, and says why
        }
        due += period;
        const auto now = Clock::now();
        if (due < now) {
            due = now;
        } else {
            std::this_thread::sleep_until(due);
        }
    }
}

void report(plp_hd *port, plp_sim *sim, const Record &record, double wall_s) {
    plp_hd_statistics t;
    plp_hd_state s;
    plp_statistics tissue;
    plp_latency steps;
    check_hd(plp_hd_get_statistics(port, &t, sizeof t));
    check_hd(plp_hd_get_state(port, &s, sizeof s));
    check(plp_sim_get_statistics(sim, &tissue, sizeof tissue));
    check(plp_sim_get_latency(sim, &steps, sizeof steps));
    const auto n = [](std::uint64_t count) { return static_cast<unsigned long long>(count); };
    std::printf("servo ticks          %llu\n", n(t.ticks));
    std::printf("servo period         p50 %.2f  p99 %.2f  p99.9 %.2f  max %.2f ms\n", 1e3 * t.p50_s, 1e3 * t.p99_s,
                1e3 * t.p999_s, 1e3 * t.max_s);
    std::printf("misses               %llu over 1.1 ms, %llu over 2 ms, longest run %llu\n", n(t.over_1_1_ms),
                n(t.over_2_ms), n(t.longest_run_over_1_1_ms));
    std::printf("within a tick        p50 %.0f  p99 %.0f  max %.0f us\n", 1e6 * t.work_p50_s, 1e6 * t.work_p99_s,
                1e6 * t.work_max_s);
    std::printf("force age            p50 %.1f  p99 %.1f  max %.1f ms\n", 1e3 * t.age_p50_s, 1e3 * t.age_p99_s,
                1e3 * t.age_max_s);
    std::printf("peak force           %.3f N\n", std::sqrt(record.peak_force_2()));
    std::printf("simulation           %llu nodes, step p50 %.2f  p99 %.2f ms, real-time factor %.2f\n", n(tissue.node_count),
                1e3 * steps.p50_s, 1e3 * steps.p99_s, tissue.time_s / wall_s);
    std::printf("faults              ");
    for (int i = 0; i < PLP_HD_FAULT_COUNT; ++i) {
        if (s.fault_ticks[i] > 0) std::printf(" %s %llu", plp_hd_fault_name(1u << i), n(s.fault_ticks[i]));
    }
    std::printf("%s\n", s.faults_ever == 0 ? " none" : "");
    std::printf("period histogram\n");
    for (int i = 0; i < PLP_HD_PERIOD_BUCKETS; ++i) {
        if (t.periods[i] > 0) std::printf("  %5.2f ms %s %llu\n", 0.01 * i, i == PLP_HD_PERIOD_BUCKETS - 1 ? "+" : " ", n(t.periods[i]));
    }
}

} // namespace

int main(int argc, char **argv) {
    Options options;
    if (!options.parse(argc, argv) || (options.is_virtual && !IS_EMULATED)) {
        std::fputs(Options::HELP, stderr);
        return 2;
    }
    check(plp_check_abi());
    if (options.is_virtual) use_virtual_time();

    // The tissue, and a ball to touch it with.
    plp_model *model = build(options);
    plp_sim_desc settings = plp_sim_desc_default();
    const unsigned cores = std::thread::hardware_concurrency();
    settings.threads = options.threads > 0 ? options.threads : cores > 1 ? cores - 1 : 1;
    plp_tool_part ball = plp_sphere(RADIUS_M);
    plp_tool_desc probe = plp_tool_desc_default();
    probe.parts = &ball;
    probe.part_count = 1;
    plp_sim *sim = nullptr;
    plp_tool *tool = nullptr;
    check(plp_sim_create(model, &settings, &sim));
    check(plp_tool_create(sim, &probe, &tool));

    // The device, with its workspace before the skin.
    Record record(static_cast<std::size_t>(std::ceil(1.05 * 1000.0 * options.seconds)));
    plp_hd_desc how = plp_hd_desc_default();
    how.device_name = options.device.empty() ? nullptr : options.device.c_str();
    how.mapping = map_workspace(find_skin(model, sim), options.scale);
    how.on_tick = Record::on_tick;
    how.on_tick_user = &record;
    if (options.is_virtual) how.clock = emulated_time;
    plp_hd *port = nullptr;
    plp_hd_info device;
    check_hd(plp_hd_open(&how, &port));
    check_hd(plp_hd_get_info(port, &device, sizeof device));
    if (!script_hand(options)) {
        std::fprintf(stderr, "%s is no motion\n", options.motion.c_str());
        return 2;
    }
    std::printf("device               %s, %.1f N at most\n", device.model, device.max_force_n);

    // Touch.
    check_hd(plp_hd_attach(port, tool));
    check_hd(plp_hd_start(port));
    const auto start = std::chrono::steady_clock::now();
    if (options.is_virtual) {
        for (long i = 0; i < std::lround(options.seconds / settings.step_s); ++i) {
            pass_virtual_time(settings.step_s);
            check(plp_sim_step(sim));
        }
    } else {
        std::atomic<bool> is_done{false};
        std::thread stepper(step_in_time, sim, settings.step_s, std::cref(is_done));
        std::this_thread::sleep_for(std::chrono::duration<double>(options.seconds));
        check_hd(plp_hd_stop(port)); // first the force, then the tissue
        is_done = true;
        stepper.join();
    }
    const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    check_hd(plp_hd_stop(port));

    report(port, sim, record, wall_s);
    const bool is_written = record.write(options.csv);
    if (!is_written) std::fprintf(stderr, "%s cannot be written\n", options.csv.c_str());

    plp_hd_close(port);
    plp_tool_destroy(tool);
    plp_sim_destroy(sim);
    plp_model_destroy(model);
    return is_written ? 0 : 1;
}
