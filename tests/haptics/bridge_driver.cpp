// In real time, with the simulation's own thread: whatever fails (servo, simulation, device, or their host), the force goes to
// zero, a status says so, nothing hangs, and what mends is felt again. No time is asserted, but that things come.
#include <atomic>
#include <chrono>
#include <functional>
#include <thread>

#include "scene.h"

namespace {

void rest() { std::this_thread::sleep_for(std::chrono::milliseconds(1)); }

/// Ticks whose force was none that a device may get.
std::atomic<unsigned> bad_ticks{0};
/// Ticks that found their tool busy, and those of them that kept its force.
std::atomic<unsigned> busy_ticks{0}, busy_ticks_with_force{0};

/// Where two devices lie, so that both balls touch the one block.
constexpr double AT_X_M[2] = {0.010, 0.030};

/// A device with its tool.
struct Hand {
    unsigned index;
    plp_hd *port = nullptr;
    plp_tool *tool = nullptr;

    Hand(plp_sim *sim, unsigned i) : index(i) {
        plp_hd_desc desc = press_desc(i == 0 ? nullptr : "Left Device");
        desc.mapping.base = plp_pose_at(AT_X_M[i], 0.02, 0.05);
        desc.clock = nullptr;
        desc.on_tick = [](void *, const plp_hd_tick *t) {
            if (!(length(t->device_force_n) <= 3.3 + 1e-12)) ++bad_ticks; // a NaN is one too
            if (t->status != PLP_ERR_BUSY) return;
            ++busy_ticks;
            if (length(t->device_force_n) > 0.0 && t->faults == 0) ++busy_ticks_with_force;
        };
        HD_ANSWERS(PLP_OK, plp_hd_open(&desc, &port));
        tool = ball_for(sim, port);
        HD_ANSWERS(PLP_OK, plp_hd_attach(port, tool));
        HD_ANSWERS(PLP_OK, plp_hd_start(port));
    }

    ~Hand() {
        HD_ANSWERS(PLP_OK, plp_hd_close(port));
        ANSWERS(PLP_OK, plp_tool_destroy(tool));
    }

    plp_hd_state state() const {
        plp_hd_state state;
        HD_ANSWERS(PLP_OK, plp_hd_get_state(port, &state, sizeof state));
        return state;
    }

    double motors() const {
        hd_emulator_truth truth;
        hd_emulator_get_truth(device(index), &truth);
        return length(truth.force_n);
    }

    void wait_until(const char *what, const std::function<bool(const plp_hd_state &)> &holds) const {
        for (int i = 0; !holds(state()); ++i) {
            if (i == 20000) {
                const plp_hd_state s = state();
                std::fprintf(stderr, "never: %s; faults 0x%x, servo 0x%x, %g N\n", what, s.faults, s.last.servo_flags,
                             length(s.last.device_force_n));
                std::exit(1);
            }
            rest();
        }
    }

    /// The hand leaves the tissue and stays outside until a force would count in full; then it presses. A servo that is held up
    /// on its way in is let go there, as it should be: the hand begins again.
    void press_anew(double travel_m = 0.012) const {
        const auto is_let_go = [](const plp_hd_state &s) { return (s.last.servo_flags & PLP_SERVO_WAITING) != 0; };
        const auto is_felt = [](const plp_hd_state &s) { return s.last.device_force_n[2] > 0.1; };
        for (int tries = 0; tries < 20; ++tries) {
            const hd_emulator_motion away = lift_motion();
            hd_emulator_set_motion(device(index), &away);
            wait_until("the tool engages", [](const plp_hd_state &s) {
                return s.last.status == PLP_OK && s.last.tick > 1 && s.last.servo_flags == 0 &&
                       length(s.last.device_force_n) == 0.0;
            });
            hd_emulator_motion motion = press_motion(hd_emulator_time_s());
            motion.travel_m = travel_m;
            hd_emulator_set_motion(device(index), &motion);
            wait_until("the tissue is felt, or let go",
                       [&](const plp_hd_state &s) { return is_felt(s) || is_let_go(s); });
            if (is_felt(state())) return;
        }
        CHECK(!"the tissue is felt");
    }

    /// The fault is told, and the force is gone.
    void wait_for_none(uint32_t fault) const {
        wait_until("the fault is told",
                   [fault](const plp_hd_state &s) { return (s.faults_ever & fault) != 0; });
        wait_until("the force goes", [](const plp_hd_state &s) { return length(s.last.device_force_n) == 0.0; });
    }

    void wait_for_ticks(unsigned count) const {
        const std::uint64_t end = state().last.tick + count;
        wait_until("ticks go on", [end](const plp_hd_state &s) { return s.last.tick >= end; });
    }
};

/// A block that steps on a thread of the library's own.
struct World {
    plp_model *model = coarse_block();
    plp_sim *sim = simulation(model);

    World() {
        hd_emulator_reset();
        ANSWERS(PLP_OK, plp_sim_start(sim, nullptr));
    }

    ~World() {
        ANSWERS(PLP_OK, plp_sim_destroy(sim));
        ANSWERS(PLP_OK, plp_model_destroy(model));
    }

    plp_event wait_for(uint32_t kind) const {
        plp_event event{};
        for (int i = 0; event.kind != kind; ++i) {
            CHECK(i < 20000);
            if (plp_sim_poll_event(sim, &event, sizeof event) == PLP_NOTHING) rest();
        }
        return event;
    }
};

void a_servo_that_stops_calling_is_told_to_both_sides() {
    World world;
    const Hand hand(world.sim, 0);
    hand.press_anew();
    hd_emulator_stall(0.6);
    hand.wait_until("the bridge misses its servo", [](const plp_hd_state &s) { return (s.faults & PLP_HD_FAULT_SERVO) != 0; });
    CHECK(world.wait_for(PLP_EVENT_SERVO_SILENT).tool_id == plp_tool_get_id(hand.tool));
    // The servo goes on as one that has paused: no force until it has engaged.
    hand.wait_until("the servo goes on", [](const plp_hd_state &s) { return (s.faults & PLP_HD_FAULT_SERVO) == 0; });
    hand.wait_until("the force goes", [](const plp_hd_state &s) {
        return length(s.last.device_force_n) == 0.0 && (s.last.servo_flags & PLP_SERVO_WAITING) != 0;
    });
    hand.press_anew();
}

void calls_from_two_threads_at_once_take_the_force_away() {
    World world;
    const Hand hand(world.sim, 0);
    hand.press_anew();
    // The scheduler ticks; this thread does so too, where it must not.
    while (hand.state().fault_ticks[7] == 0) {
        const plp_status answer = plp_hd_run_tick(hand.port);
        CHECK(answer == PLP_OK || answer == PLP_ERR_BUSY);
        // Not so fast that the servo's clock seems to stand still.
        std::this_thread::sleep_for(std::chrono::microseconds(20));
    }
    hand.wait_for_none(PLP_HD_FAULT_BUSY);
    hand.press_anew();
}

void a_thread_that_looks_at_the_tool_costs_its_servo_no_tick() {
    World world;
    const Hand hand(world.sim, 0);
    hand.press_anew();
    const std::uint64_t end = hand.state().last.tick + 200;
    busy_ticks = 0;
    while (hand.state().last.tick < end) {
        plp_servo_statistics statistics;
        const plp_status status = plp_tool_get_servo_statistics(hand.tool, &statistics, sizeof statistics);
        CHECK(status == PLP_OK || status == PLP_ERR_BUSY);
    }
    CHECK(busy_ticks == 0);
}

void a_tick_that_finds_another_thread_inside_the_tool_feels_what_it_felt() {
    World world;
    const Hand hand(world.sim, 0);
    busy_ticks = busy_ticks_with_force = 0;
    // A thread that is held up inside for longer than a force lasts may take it away; then the hand presses anew.
    for (int presses = 0; busy_ticks_with_force < 5; ++presses) {
        CHECK(presses < 50);
        hand.press_anew();
        while (busy_ticks_with_force < 5 && length(hand.state().last.device_force_n) > 0.0) {
            plp_force force;
            const plp_status status = plp_tool_get_force(hand.tool, &force);
            CHECK(status == PLP_OK || status == PLP_ERR_BUSY);
        }
    }
    hand.wait_for_ticks(20);
}

void a_simulation_that_stands_lets_go_and_is_felt_again() {
    World world;
    const Hand hand(world.sim, 0);
    hand.press_anew();
    ANSWERS(PLP_OK, plp_sim_pause(world.sim));
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    hand.wait_until("the force decays", [](const plp_hd_state &s) { return (s.faults & PLP_HD_FAULT_STALE) != 0; });
    ANSWERS(PLP_OK, plp_sim_resume(world.sim));
    hand.wait_until("steps come", [](const plp_hd_state &s) { return (s.faults & PLP_HD_FAULT_STALE) == 0; });
    hand.press_anew();
    // One that never goes on lets go for good.
    ANSWERS(PLP_OK, plp_sim_pause(world.sim));
    hand.wait_until("it lets go for good", [](const plp_hd_state &s) {
        return (s.last.servo_flags & PLP_SERVO_WAITING) != 0 && length(s.last.device_force_n) == 0.0;
    });
    hand.wait_for_ticks(20);
    CHECK(length(hand.state().last.device_force_n) == 0.0 && hand.motors() == 0.0);
    ANSWERS(PLP_OK, plp_sim_resume(world.sim));
    hand.press_anew();
}

void a_simulation_that_diverges_lets_go_and_is_felt_again_after_a_reset() {
    World world;
    const Hand hand(world.sim, 0);
    hand.press_anew();
    // A tool that nobody can move so fast throws the tissue out of all numbers.
    plp_tool *wild = ball(world.sim);
    plp_event event{};
    for (int i = 0; event.kind != PLP_EVENT_DIVERGED; ++i) {
        CHECK(i < 20000);
        const plp_motion motion = plp_motion_at(0.02, 0.02, i % 2 ? 0.0 : 0.06);
        CHECK(plp_tool_set_pose(wild, &motion) >= 0);
        rest();
        plp_sim_poll_event(world.sim, &event, sizeof event);
    }
    hand.wait_for_none(PLP_HD_FAULT_TISSUE);
    CHECK(hand.state().last.status == PLP_STOPPED);
    ANSWERS(PLP_OK, plp_tool_destroy(wild));
    ANSWERS(PLP_OK, plp_sim_reset(world.sim));
    ANSWERS(PLP_OK, plp_sim_resume(world.sim));
    hand.press_anew();
}

void a_servo_outlives_its_simulation() {
    World world;
    {
        const Hand hand(world.sim, 0);
        hand.press_anew();
        ANSWERS(PLP_OK, plp_sim_destroy(world.sim));
        hand.wait_for_none(PLP_HD_FAULT_TISSUE);
        hand.wait_for_ticks(200);
        const plp_hd_state s = hand.state();
        CHECK(s.last.status == PLP_STOPPED && (s.last.servo_flags & PLP_SERVO_STOPPED) != 0);
        CHECK(length(s.last.device_force_n) == 0.0 && hand.motors() == 0.0);
    }
    world.sim = simulation(world.model);
    ANSWERS(PLP_OK, plp_sim_start(world.sim, nullptr));
}

void a_device_that_reports_no_numbers_or_jumps_is_let_go() {
    World world;
    const Hand hand(world.sim, 0);
    hand.press_anew();
    hd_emulator_inject_nan(device(), 5);
    hand.wait_for_none(PLP_HD_FAULT_NOT_FINITE);
    hand.press_anew();
    const double far[3] = {0.0, 0.1, 0.0}, nowhere[3] = {0.0, 0.0, 0.0};
    hd_emulator_inject_jump(device(), far);
    hand.wait_for_none(PLP_HD_FAULT_JUMP);
    hd_emulator_inject_jump(device(), nowhere);
    hand.wait_until("both jumps are told", [](const plp_hd_state &s) { return s.fault_ticks[1] >= 2; });
    hand.press_anew();
}

void buttons_come_out_as_events_of_their_tool() {
    World world;
    const Hand hand(world.sim, 0);
    hand.wait_for_ticks(20);
    hd_emulator_set_buttons(device(), HD_DEVICE_BUTTON_2);
    const plp_event event = world.wait_for(PLP_EVENT_BUTTONS);
    CHECK(event.tool_id == plp_tool_get_id(hand.tool) && event.buttons == HD_DEVICE_BUTTON_2);
}

void two_hands_feel_each_their_own_force() {
    World world;
    const Hand right(world.sim, 0), left(world.sim, 1);
    right.press_anew();
    CHECK(length(left.state().last.device_force_n) == 0.0);
    left.press_anew(0.009);
    right.wait_until("the first hand still feels", [](const plp_hd_state &s) { return s.last.device_force_n[2] > 0.1; });
    const hd_emulator_motion away = lift_motion();
    hd_emulator_set_motion(device(0), &away);
    right.wait_until("the first hand leaves", [](const plp_hd_state &s) { return length(s.last.device_force_n) == 0.0; });
    left.wait_until("the second hand still feels", [](const plp_hd_state &s) { return s.last.device_force_n[2] > 0.1; });
}

} // namespace

int main() {
    a_servo_that_stops_calling_is_told_to_both_sides();
    calls_from_two_threads_at_once_take_the_force_away();
    a_thread_that_looks_at_the_tool_costs_its_servo_no_tick();
    a_tick_that_finds_another_thread_inside_the_tool_feels_what_it_felt();
    a_simulation_that_stands_lets_go_and_is_felt_again();
    a_simulation_that_diverges_lets_go_and_is_felt_again_after_a_reset();
    a_servo_outlives_its_simulation();
    a_device_that_reports_no_numbers_or_jumps_is_let_go();
    buttons_come_out_as_events_of_their_tool();
    two_hands_feel_each_their_own_force();
    hd_emulator_reset();
    CHECK(bad_ticks == 0);
    std::puts("bridge driver: ok");
}
