// All that the emulator knows, behind one lock. Callbacks run without it; everything else is short.
#pragma once

#include <array>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>

#include "../periods.h"
#include "body.h"
#include "hand.h"

namespace emulator {

constexpr unsigned DEVICES = 3, ERRORS = 32, OPERATIONS = 64, CAPABILITIES = 5;
/// Handles are not indices, so that a forgotten initialisation (0) is not a device.
constexpr HHD FIRST_HANDLE = 1;

/// What a frame shows, SI.
struct Reading {
    Vec3 position_m{}, velocity_m_s{}, angles_rad{}, angular_rad_s{};
    Vec3 force_n{}, gimbal_n_m{}, torque_n_m{};
    int buttons = 0;
};

struct Device {
    Device() { clear(); }
    void clear();

    bool is_open = false;
    hd_emulator_device desc;
    Hand hand;
    hd_emulator_target target;
    Body body;
    Encoders encoders;
    Vec3 angles_before{};
    Vec3 angular_rad_s{};

    std::array<bool, CAPABILITIES> is_on{};
    HDenum calibration = HD_CALIBRATION_OK;
    int buttons = 0;
    double temperature = 0.0, speed_limit_m_s = 0.0;

    unsigned nan_frames = 0, error_frames = 0;
    HDerror error = HD_SUCCESS;
    Vec3 offset_m{};

    int depth = 0; // of nested frames
    std::uint64_t ended_in_tick = 0, frames = 0;
    Reading current, last;

    // What the last frame asked of the motors, and when; they do it until the next one.
    Vec3 motor_force_n{}, motor_torque_n_m{};
    double motor_time_s = 0.0;
};

struct Operation {
    HDSchedulerHandle handle = 0; // 0: a free place
    HDSchedulerCallback callback = nullptr;
    void *user = nullptr;
    unsigned priority = 0;
    bool is_synchronous = false, is_removed = false;
};

struct State {
    State() { hd_emulator_device_init(&next_device); }

    std::mutex mutex;
    std::condition_variable changed; // operations came, ended, or the scheduler is to stop

    std::array<Device, DEVICES> devices;
    hd_emulator_device next_device; // what the next one that is opened will be
    HHD current = HD_INVALID_HANDLE;
    std::array<HDErrorInfo, ERRORS> errors{};
    unsigned error_count = 0;

    std::array<Operation, OPERATIONS> operations{};
    HDSchedulerHandle next_handle = 1, running = 0;
    std::thread thread;
    std::thread::id servo; // of the thread that runs callbacks now
    bool is_started = false, is_stopping = false, is_virtual = false;

    double period_s = 1e-3, spin_s = 50e-6, stall_s = 0.0;
    double start_s = 0.0, tick_start_s = 0.0, tick_time_s = 0.0, body_time_s = 0.0, last_period_s = 1e-3;
    double virtual_s = 0.0;
    std::uint64_t tick = 0;
    palpate_hd::Periods periods;

    /// The device of a handle that is open, or none.
    Device *find(HHD handle);
    /// The current device; without one says HD_BAD_HANDLE on the stack.
    Device *current_device();
    /// Puts an error on the stack; the oldest falls off a full one.
    void raise(HDerror code, HHD handle);
    HHD handle_of(const Device &device) const;
};

/// The one state. It is never destroyed, because a program may end while the scheduler runs.
State &state();

/// Lets all bodies move until this time since the scheduler's start, and the encoders look.
void pass_time(State &s, double until_s);

} // namespace emulator
