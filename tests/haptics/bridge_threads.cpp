// In real time, with the scheduler's own thread: everything is destroyed in every order under a running servo, two threads
// tick at once, and states are read meanwhile. No time is asserted: these tests say that nothing hangs, crashes or pushes.
#include <atomic>
#include <chrono>
#include <thread>

#include "scene.h"

namespace {

void rest() { std::this_thread::sleep_for(std::chrono::milliseconds(5)); }

plp_hd_state state_of(plp_hd *port) {
    plp_hd_state state;
    HD_ANSWERS(PLP_OK, plp_hd_get_state(port, &state, sizeof state));
    return state;
}

/// A servo in real time, and a thread that steps.
struct Running {
    plp_model *model = coarse_block();
    plp_sim *sim = simulation(model);
    plp_tool *tool = nullptr;
    plp_hd *port = nullptr;
    std::atomic<bool> is_done{false};
    std::thread stepper;

    Running() {
        hd_emulator_reset();
        plp_hd_desc desc = press_desc();
        desc.clock = nullptr;
        HD_ANSWERS(PLP_OK, plp_hd_open(&desc, &port));
        tool = ball_for(sim, port);
        const hd_emulator_motion motion = press_motion(0.0);
        hd_emulator_set_motion(device(), &motion);
        HD_ANSWERS(PLP_OK, plp_hd_attach(port, tool));
        HD_ANSWERS(PLP_OK, plp_hd_start(port));
        stepper = std::thread([this] {
            while (!is_done) ANSWERS(PLP_OK, plp_sim_step(sim));
        });
        while (state_of(port).last.tick < 20) rest();
    }

    void end_steps() {
        is_done = true;
        if (stepper.joinable()) stepper.join();
    }
};

enum { PORT, TOOL, SIM, MODEL, KINDS };

void all_go_in_any_order_under_a_running_servo() {
    for (int first = 0; first < KINDS; ++first) {
        for (int second = 0; second < KINDS; ++second) {
            if (second == first) continue;
            Running world;
            const int order[KINDS + 2] = {first, second, PORT, TOOL, SIM, MODEL};
            bool is_gone[KINDS] = {};
            for (const int kind : order) {
                if (is_gone[kind]) continue;
                is_gone[kind] = true;
                if (kind == SIM) world.end_steps(); // a simulation has one owner
                switch (kind) {
                case PORT: HD_ANSWERS(PLP_OK, plp_hd_close(world.port)); break;
                case TOOL:
                    // The servo must let go of a tool first; a detached one may go at any time.
                    if (!is_gone[PORT]) HD_ANSWERS(PLP_OK, plp_hd_attach(world.port, nullptr));
                    ANSWERS(PLP_OK, plp_tool_destroy(world.tool));
                    break;
                case SIM: ANSWERS(PLP_OK, plp_sim_destroy(world.sim)); break;
                default: ANSWERS(PLP_OK, plp_model_destroy(world.model)); break;
                }
                if (kind == SIM && !is_gone[PORT] && !is_gone[TOOL]) {
                    while ((state_of(world.port).faults & PLP_HD_FAULT_TISSUE) == 0) rest();
                    CHECK(length(state_of(world.port).last.device_force_n) == 0.0);
                }
                if (!is_gone[PORT]) {
                    const std::uint64_t tick = state_of(world.port).last.tick;
                    while (state_of(world.port).last.tick == tick) rest(); // it goes on
                }
            }
            world.end_steps();
        }
    }
}

void a_second_thread_in_a_tick_is_refused_and_the_force_goes() {
    Running world;
    // The scheduler ticks; this thread does so too, where it must not.
    plp_status answer = PLP_OK;
    while ((state_of(world.port).fault_ticks[7]) == 0) {
        answer = plp_hd_run_tick(world.port);
        CHECK(answer == PLP_OK || answer == PLP_ERR_BUSY);
    }
    CHECK((state_of(world.port).faults_ever & PLP_HD_FAULT_BUSY) != 0);
    HD_ANSWERS(PLP_OK, plp_hd_close(world.port));
    CHECK(plp_hd_run_tick(world.port) == PLP_ERR_INVALID_HANDLE);
    world.end_steps();
    ANSWERS(PLP_OK, plp_tool_destroy(world.tool));
    ANSWERS(PLP_OK, plp_sim_destroy(world.sim));
    ANSWERS(PLP_OK, plp_model_destroy(world.model));
}

void a_stalled_scheduler_delays_closing_and_no_more() {
    Running world;
    hd_emulator_stall(0.2);
    while ((state_of(world.port).faults & PLP_HD_FAULT_SERVO) == 0) rest();
    HD_ANSWERS(PLP_OK, plp_hd_close(world.port));
    world.end_steps();
    ANSWERS(PLP_OK, plp_tool_destroy(world.tool));
    ANSWERS(PLP_OK, plp_sim_destroy(world.sim));
    ANSWERS(PLP_OK, plp_model_destroy(world.model));
}

void two_devices_share_the_scheduler_and_close_in_both_orders() {
    for (int first = 0; first < 2; ++first) {
        hd_emulator_reset();
        plp_hd *ports[2] = {};
        const char *names[2] = {"Left Device", "Right Device"};
        for (int i = 0; i < 2; ++i) {
            plp_hd_desc desc = plp_hd_desc_default();
            desc.device_name = names[i];
            HD_ANSWERS(PLP_OK, plp_hd_open(&desc, &ports[i]));
            HD_ANSWERS(PLP_OK, plp_hd_start(ports[i]));
        }
        for (plp_hd *port : ports) {
            while (state_of(port).last.tick < 20) rest();
            CHECK(state_of(port).faults_ever == 0);
        }
        HD_ANSWERS(PLP_OK, plp_hd_close(ports[first]));
        const std::uint64_t tick = state_of(ports[1 - first]).last.tick;
        while (state_of(ports[1 - first]).last.tick == tick) rest();
        HD_ANSWERS(PLP_OK, plp_hd_close(ports[1 - first]));
    }
}

} // namespace

int main() {
    all_go_in_any_order_under_a_running_servo();
    a_second_thread_in_a_tick_is_refused_and_the_force_goes();
    a_stalled_scheduler_delays_closing_and_no_more();
    two_devices_share_the_scheduler_and_close_in_both_orders();
    hd_emulator_reset();
    std::puts("bridge threads: ok");
}
