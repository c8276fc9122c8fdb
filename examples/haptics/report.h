// How well servo and simulation kept time, and what the hand got.
#pragma once

#include "check.h"
#include "record.h"

inline void report_servo(plp_hd *port, plp_tool *tool, const Record &record, double wall_s) {
    plp_hd_statistics t;
    plp_servo_statistics servo;
    check_hd(plp_hd_get_statistics(port, &t, sizeof t));
    check(plp_tool_get_servo_statistics(tool, &servo, sizeof servo));
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
    const std::vector<double> latencies = record.latencies_s();
    const auto quantile_ms = [&latencies](double part) {
        if (latencies.empty()) return 0.0;
        return 1e3 * latencies[static_cast<std::size_t>(part * static_cast<double>(latencies.size() - 1))];
    };
    std::printf("pose to force        p50 %.1f  p99 %.1f  max %.1f ms\n", quantile_ms(0.5), quantile_ms(0.99),
                1e3 * servo.longest_latency_s);
    std::printf("fresh forces         %.0f a second\n", static_cast<double>(record.fresh()) / wall_s);
    std::printf("without valid force  %llu ticks\n", n(record.invalid()));
    std::printf("peak force           %.3f N\n", record.peak_n());
    std::printf("least energy         %.3g J that the loop held; below 0 it gave more than it got\n", servo.least_energy_j);
}

inline void report_simulation(plp_sim *sim, double wall_s) {
    plp_statistics tissue;
    plp_latency steps;
    check(plp_sim_get_statistics(sim, &tissue, sizeof tissue));
    check(plp_sim_get_latency(sim, &steps, sizeof steps));
    const auto n = [](std::uint64_t count) { return static_cast<unsigned long long>(count); };
    std::printf("simulation           %llu nodes, %u substeps, step p50 %.2f  p99 %.2f ms, real-time factor %.2f\n",
                n(tissue.node_count), tissue.substeps_per_step, 1e3 * steps.p50_s, 1e3 * steps.p99_s, tissue.time_s / wall_s);
    std::printf("steps                %.0f a second, %llu overran, %.3f s let go\n",
                static_cast<double>(tissue.steps) / wall_s, n(tissue.overrun_count), tissue.dropped_s);
}

inline void report_faults(plp_hd *port) {
    plp_hd_state s;
    plp_hd_statistics t;
    check_hd(plp_hd_get_state(port, &s, sizeof s));
    check_hd(plp_hd_get_statistics(port, &t, sizeof t));
    const auto n = [](std::uint64_t count) { return static_cast<unsigned long long>(count); };
    std::printf("faults              ");
    for (int i = 0; i < PLP_HD_FAULT_COUNT; ++i) {
        if (s.fault_ticks[i] > 0) std::printf(" %s %llu", plp_hd_fault_name(1u << i), n(s.fault_ticks[i]));
    }
    std::printf("%s\n", s.faults_ever == 0 ? " none" : "");
    std::printf("period histogram\n");
    for (int i = 0; i < PLP_HD_PERIOD_BUCKETS; ++i) {
        const char *more = i == PLP_HD_PERIOD_BUCKETS - 1 ? "+" : " ";
        if (t.periods[i] > 0) std::printf("  %5.2f ms %s %llu\n", 0.01 * i, more, n(t.periods[i]));
    }
}
