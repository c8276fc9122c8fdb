// What the control of virtual time shares with the scheduler.
#pragma once

#include "state.h"

namespace emulator {

/// One tick at a time since the start: bodies move, then callbacks run. The lock is held, and let go for each callback.
void tick(State &s, std::unique_lock<std::mutex> &lock, double time_s);

/// Ends the scheduler and waits for its thread; not from a callback.
void stop(State &s);

} // namespace emulator
