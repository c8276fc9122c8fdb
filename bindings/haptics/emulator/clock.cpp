#include "clock.h"

#include <chrono>
#include <thread>

#if defined(__linux__)
#include <cerrno>
#include <pthread.h>
#include <sched.h>
#include <time.h>
#endif

namespace emulator {

double now_s() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void wait_until_s(double deadline_s, double spin_s) {
    const double wake_s = deadline_s - spin_s;
    if (now_s() < wake_s) {
#if defined(__linux__)
        // steady_clock is CLOCK_MONOTONIC here; an absolute sleep is not shifted by what happens before it begins.
        timespec wake{};
        wake.tv_sec = static_cast<time_t>(wake_s);
        wake.tv_nsec = static_cast<long>((wake_s - static_cast<double>(wake.tv_sec)) * 1e9);
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &wake, nullptr) == EINTR) {}
#else
        std::this_thread::sleep_for(std::chrono::duration<double>(wake_s - now_s()));
#endif
    }
    while (now_s() < deadline_s) {}
}

bool ask_for_priority() {
#if defined(__linux__)
    sched_param first{};
    first.sched_priority = 80;
    return pthread_setschedparam(pthread_self(), SCHED_FIFO, &first) == 0;
#else
    return false;
#endif
}

} // namespace emulator
