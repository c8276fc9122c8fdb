// A port: what the servo thread, host threads and readers share of one device.
#pragma once

#include <HD/hd.h>

#include <atomic>

#include "mapping.h"
#include "palpate_hdapi.h"
#include "periods.h"
#include "published.h"

/// Ports live in a static array and are never freed: a servo that comes late meets a closed port, not freed memory.
struct plp_hd {
    // Written by host functions while nothing ticks, read by ticks.
    HHD device = HD_INVALID_HANDLE;
    plp_hd_desc desc{};
    plp_hd_info info{};
    palpate_hd::Mapping mapping;
    HDSchedulerHandle callback = 0;
    bool is_scheduled = false;

    // Between host and servo.
    std::atomic<bool> is_open{false}, is_started{false};
    std::atomic<bool> asks_resume{false}, has_new_tool{false}, met_second_caller{false};
    std::atomic<plp_tool *> tool{nullptr};
    std::atomic<double> started_s{0.0};
    std::atomic_flag busy = ATOMIC_FLAG_INIT; // held by the thread that ticks
    std::atomic<std::uint32_t> inside{0};     // odd during a tick

    // From the servo to readers.
    palpate_hd::Published<plp_hd_tick> newest;
    std::atomic<std::uint64_t> fault_ticks[PLP_HD_FAULT_COUNT] = {};
    std::atomic<std::uint32_t> faults_ever{0}, last_hd_error{HD_SUCCESS};
    palpate_hd::Periods periods, work, ages;

    // Of the ticking thread alone.
    struct Servo {
        bool has_ticked = false, has_seen = false, is_placed = false, is_led = false;
        bool lets_go = false;              // whatever the next tick finds, it asks for no force
        double last_s = 0.0, seen_s = 0.0, stamp_s = 0.0;
        palpate_hd::Vec3 seen_m{0, 0, 0};  // where the device was last, device frame
        plp_motion sent{};                 // where the device was told to be, world frame
        std::uint32_t latched = 0;
        std::uint64_t tick = 0;
    } servo;

    double now_s() const noexcept;
};

namespace palpate_hd {

/// Errors of HDAPI are one stack for all devices: what one port finds of another is kept for it here. Returns the first
/// error of this device, HD_SUCCESS without, and empties the stack.
std::uint32_t take_errors(plp_hd &port) noexcept;

/// The fault that an HDAPI error is, 0 for one that says only that a question had no answer.
std::uint32_t fault_of(std::uint32_t hd_error) noexcept;

/// All ports.
extern plp_hd ports[PLP_HD_PORTS];

} // namespace palpate_hd
