// The servo loop: callbacks in the order of their priorities, once a tick.
#include <chrono>
#include <cmath>
#include <system_error>
#include <utility>

#include "clock.h"
#include "scheduler.h"

using namespace emulator;
using Lock = std::unique_lock<std::mutex>;

namespace {

Operation *find(State &s, HDSchedulerHandle handle) {
    for (Operation &operation : s.operations) {
        if (handle != 0 && operation.handle == handle) return &operation;
    }
    return nullptr;
}

/// Runs one callback without the lock, and takes it out when it is done.
void run(State &s, Lock &lock, HDSchedulerHandle handle) {
    Operation *operation = find(s, handle);
    if (!operation || operation->is_removed) return;
    const Operation copy = *operation;
    s.running = handle;
    lock.unlock();
    const HDCallbackCode code = copy.callback(copy.user);
    lock.lock();
    s.running = 0;
    operation = find(s, handle);
    if (operation && (code == HD_CALLBACK_DONE || operation->is_removed)) {
        *operation = {};
        s.changed.notify_all();
    }
}

/// Adds an operation; 0 where there is no room.
HDSchedulerHandle add(State &s, HDSchedulerCallback callback, void *user, unsigned priority, bool is_synchronous) {
    for (Operation &operation : s.operations) {
        if (operation.handle != 0) continue;
        operation = {s.next_handle++, callback, user, priority, is_synchronous, false};
        return operation.handle;
    }
    s.raise(HD_SCHEDULER_FULL, s.current);
    return 0;
}

void loop(State &s) {
    ask_for_priority();
    Lock lock(s.mutex);
    double deadline_s = s.start_s;
    while (!s.is_stopping) {
        if (s.stall_s > 0.0) {
            const auto stall = std::chrono::duration<double>(s.stall_s);
            s.stall_s = 0.0;
            s.changed.wait_for(lock, stall, [&s] { return s.is_stopping; });
            continue;
        }
        const double period_s = s.period_s, spin_s = s.spin_s;
        deadline_s += period_s;
        lock.unlock();
        // Missed ticks stay missed: ticks in a row without time between them are no servo loop.
        const double late_s = now_s() - deadline_s;
        if (late_s > 0.0) deadline_s += period_s * std::ceil(late_s / period_s);
        wait_until_s(deadline_s, spin_s);
        lock.lock();

        const double start_s = now_s();
        if (s.tick > 0) {
            s.last_period_s = start_s - s.tick_start_s;
            s.periods.add(s.last_period_s);
        }
        s.tick_start_s = start_s;
        tick(s, lock, start_s - s.start_s);
    }
    // Who waits for a synchronous callback must not wait for ever.
    for (const Operation &operation : s.operations) {
        if (operation.is_synchronous) run(s, lock, operation.handle);
    }
    s.servo = {};
}

} // namespace

void emulator::tick(State &s, Lock &lock, double time_s) {
    ++s.tick;
    s.tick_time_s = time_s;
    s.servo = std::this_thread::get_id();
    pass_time(s, time_s);

    // Highest priority first, and among equals who came first. A short list: inserting sorts it without allocating.
    std::array<std::pair<unsigned, HDSchedulerHandle>, OPERATIONS> order;
    unsigned count = 0;
    for (const Operation &operation : s.operations) {
        if (operation.handle == 0) continue;
        unsigned at = count++;
        for (; at > 0 && (order[at - 1].first < operation.priority ||
                          (order[at - 1].first == operation.priority && order[at - 1].second > operation.handle));
             --at) {
            order[at] = order[at - 1];
        }
        order[at] = {operation.priority, operation.handle};
    }
    for (unsigned i = 0; i < count; ++i) run(s, lock, order[i].second);

    // A frame that was not ended writes nothing, and must not hold the old force.
    for (Device &device : s.devices) {
        if (device.depth == 0) continue;
        device.depth = 0;
        device.motor_force_n = device.motor_torque_n_m = {};
        s.raise(HD_FRAME_ERROR, s.handle_of(device));
    }
}

void emulator::stop(State &s) {
    std::thread thread;
    {
        const Lock lock(s.mutex);
        s.is_stopping = true;
        s.changed.notify_all();
        thread = std::move(s.thread);
    }
    if (thread.joinable()) thread.join();
    const Lock lock(s.mutex);
    s.is_started = s.is_stopping = false;
    s.servo = {};
    for (Device &device : s.devices) device.motor_force_n = device.motor_torque_n_m = {};
    s.changed.notify_all();
}

void HDAPIENTRY hdStartScheduler(void) {
    State &s = state();
    const Lock lock(s.mutex);
    if (s.is_started) {
        s.raise(HD_TIMER_ERROR, s.current);
        return;
    }
    s.is_started = true;
    s.tick = 0;
    s.virtual_s = s.tick_time_s = s.body_time_s = 0.0;
    s.start_s = s.tick_start_s = now_s();
    for (Device &device : s.devices) {
        device.encoders.clear();
        device.motor_time_s = 0.0;
        device.ended_in_tick = 0;
    }
    if (s.is_virtual) return;
    try {
        s.thread = std::thread(loop, std::ref(s));
    } catch (const std::system_error &) {
        s.is_started = false;
        s.raise(HD_TIMER_ERROR, s.current);
    }
}

void HDAPIENTRY hdStopScheduler(void) {
    State &s = state();
    {
        const Lock lock(s.mutex);
        if (s.servo == std::this_thread::get_id()) { // a thread cannot wait for its own end
            s.raise(HD_INVALID_OPERATION, s.current);
            return;
        }
        if (!s.is_started) return;
    }
    stop(s);
}

void HDAPIENTRY hdSetSchedulerRate(HDulong nRate) {
    State &s = state();
    const Lock lock(s.mutex);
    if (nRate < 100 || nRate > 10000) {
        s.raise(HD_INVALID_VALUE, s.current);
        return;
    }
    s.period_s = 1.0 / static_cast<double>(nRate);
}

void HDAPIENTRY hdScheduleSynchronous(HDSchedulerCallback pCallback, void *pUserData, HDushort nPriority) {
    State &s = state();
    Lock lock(s.mutex);
    // The servo thread must not wait for itself; and where nothing runs, there is nothing to wait for.
    if (!s.is_started || s.is_virtual || s.servo == std::this_thread::get_id()) {
        lock.unlock();
        while (pCallback(pUserData) == HD_CALLBACK_CONTINUE && !s.is_virtual) {}
        return;
    }
    const HDSchedulerHandle handle = add(s, pCallback, pUserData, nPriority, true);
    s.changed.wait(lock, [&s, handle] { return !find(s, handle) || !s.is_started; });
}

HDSchedulerHandle HDAPIENTRY hdScheduleAsynchronous(HDSchedulerCallback pCallback, void *pUserData,
                                                    HDushort nPriority) {
    State &s = state();
    const Lock lock(s.mutex);
    const HDSchedulerHandle handle = add(s, pCallback, pUserData, nPriority, false);
    return handle != 0 ? handle : HD_INVALID_HANDLE;
}

void HDAPIENTRY hdUnschedule(HDSchedulerHandle hHandle) {
    State &s = state();
    Lock lock(s.mutex);
    Operation *operation = find(s, hHandle);
    if (!operation) {
        s.raise(HD_INVALID_OPERATION, s.current);
        return;
    }
    operation->is_removed = true;
    if (s.running != hHandle) {
        *operation = {};
        s.changed.notify_all();
    } else if (s.servo != std::this_thread::get_id()) {
        // Afterwards the caller may free what the callback uses.
        s.changed.wait(lock, [&s, hHandle] { return s.running != hHandle; });
    }
}

HDboolean HDAPIENTRY hdWaitForCompletion(HDSchedulerHandle hHandle, HDWaitCode param) {
    State &s = state();
    Lock lock(s.mutex);
    if (param == HD_WAIT_CHECK_STATUS) return find(s, hHandle) ? HD_TRUE : HD_FALSE;
    // Waiting for what cannot happen while one waits is an error, not an end.
    if (find(s, hHandle) && (!s.is_started || s.is_virtual || s.servo == std::this_thread::get_id())) return HD_FALSE;
    s.changed.wait(lock, [&s, hHandle] { return !find(s, hHandle) || !s.is_started; });
    return find(s, hHandle) ? HD_FALSE : HD_TRUE;
}

HDdouble HDAPIENTRY hdGetSchedulerTimeStamp(void) {
    State &s = state();
    const Lock lock(s.mutex);
    return s.is_virtual || !s.is_started ? 0.0 : now_s() - s.tick_start_s;
}
