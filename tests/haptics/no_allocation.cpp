// A tick of the bridge allocates nothing: with good frames, with every fault, and when it is refused. The allocator is
// watched by replacing it.
#include <atomic>
#include <cstdint>

#include "scene.h"

extern "C" {
void *__libc_malloc(size_t);
void *__libc_calloc(size_t, size_t);
void *__libc_realloc(void *, size_t);
void __libc_free(void *);
}

namespace {

// volatile, because compilers believe that malloc reads no variable of a program.
thread_local volatile bool armed;
std::atomic<int> counted{0}, seen{0};

void count() {
    ++seen;
    if (armed) ++counted;
}

} // namespace

extern "C" {
void *malloc(size_t size) { return count(), __libc_malloc(size); }
void *calloc(size_t n, size_t size) { return count(), __libc_calloc(n, size); }
void *realloc(void *old, size_t size) { return count(), __libc_realloc(old, size); }
void free(void *memory) {
    if (memory) count();
    __libc_free(memory);
}
}

namespace {

std::uint32_t faults_met;

void tick(plp_hd *port) {
    armed = true;
    plp_hd_run_tick(port);
    armed = false;
}

} // namespace

int main() {
    // The counter counts.
    armed = true;
    void *volatile kept = malloc(8);
    free(kept);
    armed = false;
    CHECK(counted == 2);
    counted = 0;

    plp_hd_desc desc = press_desc();
    desc.flags = PLP_HD_HOST_SERVO;
    desc.on_tick = [](void *, const plp_hd_tick *t) { faults_met |= t->faults; };
    Scene scene(desc);
    CHECK(seen > 100);
    static plp_hd *port;
    port = scene.port;
    hdScheduleAsynchronous([](void *) -> HDCallbackCode { return tick(port), HD_CALLBACK_CONTINUE; }, nullptr,
                           HD_MAX_SCHEDULER_PRIORITY);
    hdStartScheduler();
    scene.run(1.0);
    scene.expect_force();
    const double far[3] = {0.1, 0.0, 0.0};
    hd_emulator_inject_jump(device(), far);
    scene.run(0.01);
    hd_emulator_inject_nan(device(), 2);
    scene.run(0.01);
    hd_emulator_inject_error(device(), HD_COMM_ERROR, 2);
    hd_emulator_set_temperature(device(), 1.0);
    hd_emulator_set_calibration(device(), HD_CALIBRATION_NEEDS_UPDATE);
    scene.run(0.01);
    scene.stall(0.1);
    tick(port); // outside a tick of the scheduler
    ANSWERS(PLP_OK, plp_sim_destroy(scene.sim));
    scene.sim = nullptr;
    scene.run(0.01);
    tick(nullptr);
    HD_ANSWERS(PLP_OK, plp_hd_stop(port));
    tick(port);
    CHECK(faults_met == (PLP_HD_FAULT_NOT_FINITE | PLP_HD_FAULT_JUMP | PLP_HD_FAULT_DEVICE | PLP_HD_FAULT_LIMIT |
                         PLP_HD_FAULT_CALIBRATION | PLP_HD_FAULT_TISSUE | PLP_HD_FAULT_STALE | PLP_HD_FAULT_FRAME));
    hdStopScheduler();
    CHECK(counted == 0);
    std::puts("no allocation: ok");
}
