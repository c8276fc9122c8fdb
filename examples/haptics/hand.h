// The scripted hand, where the device is the emulated one; a real device has a real hand.
#pragma once

#include "options.h"

#if defined(PALPATE_HD_EMULATOR)
#include <cmath>

#include "hd_emulator.h"

/// The emulator's only device is the first: its handle is 1.
constexpr HHD EMULATED = 1;

inline double emulated_time(void *) { return hd_emulator_time_s(); }

/// Lets the emulated hand wait until a tool has engaged, then press: a second to travel 30 mm away from the user and back,
/// again and again.
inline bool script_hand(const Options &options) {
    hd_emulator_motion motion;
    int kind = HD_EMULATOR_PRESS;
    if (options.motion == "drag") kind = HD_EMULATOR_DRAG;
    if (options.motion == "tremor") kind = HD_EMULATOR_TREMOR;
    if (options.motion == "random") kind = HD_EMULATOR_RANDOM;
    if (kind == HD_EMULATOR_PRESS && options.motion != "press") {
        return hd_emulator_load_motion(EMULATED, options.motion.c_str()) == 1;
    }
    hd_emulator_motion_init(&motion, kind);
    motion.travel_m = 0.030;
    motion.speed_m_s = 0.05;
    motion.hold_s = 0.5;
    motion.wait_s = 0.7;
    if (kind == HD_EMULATOR_RANDOM) motion.start_m[2] = -0.015;
    hd_emulator_set_motion(EMULATED, &motion);
    return true;
}

inline void use_virtual_time() { hd_emulator_use_virtual_time(1); }
inline void pass_virtual_time(double seconds) { hd_emulator_advance(seconds); }
constexpr bool IS_EMULATED = true;
#else
inline double emulated_time(void *) { return 0.0; }
inline bool script_hand(const Options &) { return true; }
inline void use_virtual_time() {}
inline void pass_virtual_time(double) {}
constexpr bool IS_EMULATED = false;
#endif
