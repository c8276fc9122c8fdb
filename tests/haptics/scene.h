// What the tests of the bridge share: a block of jelly, a ball above it, and a device whose hand presses it, in virtual time.
#pragma once

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "check.h"
#include "hd_emulator.h"
#include "palpate_hdapi.h"

#define NEAR(value, expected, tolerance)                                                                              \
    do {                                                                                                              \
        const double is = (value), should = (expected);                                                               \
        if (!(std::fabs(is - should) <= (tolerance))) {                                                               \
            std::fprintf(stderr, "%s:%d: %s\n  is %.9g, not %.9g\n", __FILE__, __LINE__, #value, is, should);        \
            std::exit(1);                                                                                             \
        }                                                                                                             \
    } while (0)

/// A call of the bridge must answer this, and an error must come with a sentence.
#define HD_ANSWERS(expected, call)                                                                                    \
    do {                                                                                                              \
        const plp_status answer = (call);                                                                             \
        if (answer != (expected) || (answer < 0 && plp_hd_last_error()[0] == 0)) {                                    \
            std::fprintf(stderr, "%s:%d: %s\n  answered %s, not %s: %s\n", __FILE__, __LINE__, #call,               \
                         plp_status_name(answer), plp_status_name(expected), plp_hd_last_error());                   \
            std::exit(1);                                                                                             \
        }                                                                                                             \
    } while (0)

inline double length(const double *v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

inline double virtual_clock(void *) { return hd_emulator_time_s(); }

/// The device's origin lies 2 mm above touching the block's top (z = 0.04); device and world axes are the same.
inline plp_hd_desc press_desc(const char *device_name = nullptr) {
    plp_hd_desc desc = plp_hd_desc_default();
    desc.device_name = device_name;
    desc.mapping.base = plp_pose_at(0.02, 0.02, 0.05);
    desc.clock = virtual_clock;
    return desc;
}

/// Long enough before the tissue for a tool to engage and its force to count in full.
constexpr double ENGAGE_S = 0.65;

/// A hand that presses 12 mm down and stays: 10 mm into the jelly.
inline hd_emulator_motion press_motion(double begin_s) {
    hd_emulator_motion motion;
    hd_emulator_motion_init(&motion, HD_EMULATOR_PRESS);
    motion.travel_m = 0.012;
    motion.speed_m_s = 0.1;
    motion.hold_s = 1e6;
    motion.wait_s = begin_s;
    return motion;
}

/// A hand that stays at the device's origin, before the tissue.
inline hd_emulator_motion lift_motion() {
    hd_emulator_motion motion;
    hd_emulator_motion_init(&motion, HD_EMULATOR_HOLD);
    return motion;
}

/// The handle of the n-th device that was opened: the emulator counts them from 1.
inline HHD device(unsigned n = 0) { return 1 + n; }

/// The block of the C tests in eight times fewer cells: these tests take many steps.
inline plp_model *coarse_block() {
    plp_label_grid grid = block_grid();
    plp_label_use use = block_use();
    plp_model_desc desc = plp_model_desc_default();
    plp_model *model = nullptr;
    for (int i = 0; i < 3; ++i) {
        grid.voxels[i] = 4;
        grid.spacing_m[i] = 0.010;
    }
    grid.frame = plp_pose_at(0.005, 0.005, 0.005);
    desc.grid = &grid;
    desc.uses = &use;
    desc.use_count = 1;
    desc.fix_faces = PLP_FACE_Z_LOW;
    ANSWERS(PLP_OK, plp_model_create(&desc, &model));
    return model;
}

/// A ball that this port's device can hold.
inline plp_tool *ball_for(plp_sim *sim, plp_hd *port) {
    plp_haptic_desc haptic = plp_haptic_desc_default();
    HD_ANSWERS(PLP_OK, plp_hd_haptic(port, &haptic));
    return ball_of(sim, &haptic);
}

/// What keeps a force from being all that the tissue answers.
constexpr uint32_t HELD_BACK = PLP_SERVO_WAITING | PLP_SERVO_RAMPING | PLP_SERVO_RELEASED | PLP_SERVO_STOPPED |
                               PLP_SERVO_HELD | PLP_SERVO_DECAYING | PLP_SERVO_PAUSED | PLP_SERVO_TOO_FAST;

struct Scene {
    plp_model *model = nullptr;
    plp_sim *sim = nullptr;
    plp_tool *tool = nullptr;
    plp_hd *port = nullptr;

    explicit Scene(const plp_hd_desc &desc = press_desc(), plp_model *(*make)() = coarse_block) {
        hd_emulator_reset();
        hd_emulator_use_virtual_time(1);
        model = make();
        sim = simulation(model);
        HD_ANSWERS(PLP_OK, plp_hd_open(&desc, &port));
        tool = ball_for(sim, port);
        const hd_emulator_motion motion = press_motion(ENGAGE_S);
        hd_emulator_set_motion(device(), &motion);
        HD_ANSWERS(PLP_OK, plp_hd_attach(port, tool));
        HD_ANSWERS(PLP_OK, plp_hd_start(port));
    }

    ~Scene() {
        if (port) HD_ANSWERS(PLP_OK, plp_hd_close(port));
        ANSWERS(PLP_OK, plp_tool_destroy(tool));
        ANSWERS(PLP_OK, plp_sim_destroy(sim));
        ANSWERS(PLP_OK, plp_model_destroy(model));
    }

    /// Time passes, and the tissue with it.
    void run(double seconds) {
        for (int i = 0; i < std::lround(seconds * 1000.0); ++i) {
            hd_emulator_advance(1e-3);
            if (sim) ANSWERS(PLP_OK, plp_sim_step(sim));
        }
    }

    /// Time passes, and the tissue stands still.
    void stall(double seconds) { hd_emulator_advance(seconds); }

    plp_hd_state state() const {
        plp_hd_state s;
        HD_ANSWERS(PLP_OK, plp_hd_get_state(port, &s, sizeof s));
        return s;
    }

    /// What the motors do, in N.
    double motors() const {
        hd_emulator_truth truth;
        hd_emulator_get_truth(device(), &truth);
        return length(truth.force_n);
    }

    void move(const hd_emulator_motion &motion) { hd_emulator_set_motion(device(), &motion); }

    /// There is a force, and it counts in full.
    void expect_force() const {
        const plp_hd_state s = state();
        if (s.faults || s.last.servo_flags) std::fprintf(stderr, "faults 0x%x, servo 0x%x\n", s.faults, s.last.servo_flags);
        CHECK(s.faults == 0);
        CHECK((s.last.servo_flags & HELD_BACK) == 0);
        CHECK(motors() > 0.2);
    }

    /// No force while the hand stays in the tissue, and all of it to a hand that leaves and presses again.
    void expect_return() {
        run(0.3);
        CHECK(state().faults == 0 && motors() == 0.0 && (state().last.servo_flags & PLP_SERVO_WAITING) != 0);
        press_anew();
    }

    void press_anew() {
        move(lift_motion());
        run(0.3 + ENGAGE_S);
        move(press_motion(hd_emulator_time_s()));
        run(0.5);
        expect_force();
    }

    /// There is none, for this reason.
    void expect_none(uint32_t fault) const {
        const plp_hd_state s = state();
        if ((s.faults & fault) == 0) std::fprintf(stderr, "faults are 0x%x\n", s.faults);
        CHECK((s.faults & fault) != 0);
        CHECK(length(s.last.device_force_n) == 0.0);
        CHECK(motors() == 0.0);
    }
};
