// Who steps the tissue: the library's own thread, a thread of this program, or virtual time.
#pragma once

#include <atomic>
#include <chrono>
#include <cmath>
#include <thread>

#include "check.h"
#include "hand.h"
#include "options.h"

inline const char *drive_name(const Options &options) {
    return options.is_virtual ? "virtual time" : options.is_hosted ? "host: a thread of this program"
                                                                   : "thread: the simulation's own";
}

/// Prints what the simulation has told since the last time. Of times that were let go the first few are enough: a slow
/// machine has hundreds, and the report has their sum.
inline void tell_events(plp_sim *sim) {
    static int behind = 0;
    plp_event e;
    while (plp_sim_poll_event(sim, &e, sizeof e) == PLP_OK) {
        const auto tool = static_cast<unsigned long long>(e.tool_id);
        switch (e.kind) {
        case PLP_EVENT_DIVERGED: std::printf("%9.3f s          the tissue diverged; nothing is felt\n", e.time_s); break;
        case PLP_EVENT_DEVICE_LOST: std::printf("%9.3f s          the GPU was lost\n", e.time_s); break;
        case PLP_EVENT_FELL_BEHIND:
            if (++behind <= 3) std::printf("%9.3f s          the simulation fell behind, and let %.1f ms go\n", e.time_s, 1e3 * e.value);
            break;
        case PLP_EVENT_SERVO_SILENT: std::printf("%9.3f s          the servo of tool %llu is silent\n", e.time_s, tool); break;
        case PLP_EVENT_BUTTONS: std::printf("%9.3f s          buttons 0x%x at tool %llu\n", e.time_s, e.buttons, tool); break;
        default: break; // a newer library's
        }
    }
}

/// One step. False where there can be no more: the servo lets go of the device, and says why.
inline bool does_step(plp_sim *sim) {
    const plp_status status = plp_sim_step(sim);
    if (status < 0) std::fprintf(stderr, "the simulation failed: %s\n", plp_last_error());
    tell_events(sim);
    return status >= 0;
}

/// Steps at the pace of the wall clock, and slower where a step takes longer: it never tries to catch up.
inline void step_in_time(plp_sim *sim, double step_s, const std::atomic<bool> &is_done) {
    using Clock = std::chrono::steady_clock;
    const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(step_s));
    auto due = Clock::now();
    while (!is_done.load()) {
        if (!does_step(sim)) return;
        due += period;
        const auto now = Clock::now();
        if (due < now) {
            due = now;
        } else {
            std::this_thread::sleep_until(due);
        }
    }
}

/// Lets time pass, with the hand at the device; afterwards the device is still.
inline void let_touch(const Options &options, plp_sim *sim, double step_s, plp_hd *port) {
    const std::chrono::duration<double> all(options.seconds);
    if (options.is_virtual) {
        for (long i = 0; i < std::lround(options.seconds / step_s); ++i) {
            pass_virtual_time(step_s);
            if (!does_step(sim)) break;
        }
        check_hd(plp_hd_stop(port));
    } else if (options.is_hosted) {
        std::atomic<bool> is_done{false};
        std::thread stepper(step_in_time, sim, step_s, std::cref(is_done));
        std::this_thread::sleep_for(all);
        check_hd(plp_hd_stop(port)); // first the force, then the tissue
        is_done = true;
        stepper.join();
    } else {
        check(plp_sim_start(sim, nullptr));
        for (const auto end = std::chrono::steady_clock::now() + all; std::chrono::steady_clock::now() < end;) {
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
            tell_events(sim);
        }
        check_hd(plp_hd_stop(port));
        check(plp_sim_stop(sim));
    }
}
