// Waiting for a moment, and being first in line for the processor. All that depends on the platform is in clock.cpp.
#pragma once

namespace emulator {

/// Seconds of a clock that never goes back.
double now_s();

/// Returns at `deadline_s` of that clock, not before. Sleeps until spin_s before it and spins the rest, because sleepers
/// wake late.
void wait_until_s(double deadline_s, double spin_s);

/// Asks for real-time priority for the calling thread. Returns whether it was granted; without, everything works, with
/// longer periods now and then.
bool ask_for_priority();

} // namespace emulator
