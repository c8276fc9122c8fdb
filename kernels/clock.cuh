// The device's clock.
#pragma once
#include "layout.cuh"

// Nanoseconds since some moment, the same for all of the device; it ticks once in up to a microsecond.
__device__ inline uint64_t clock_ns() {
    uint64_t now;
    asm volatile("mov.u64 %0, %%globaltimer;" : "=l"(now));
    return now;
}

// Notes when the step began, where this kernel is its first.
__device__ inline void note_start(const Pass& pass) {
    if (pass.started && blockIdx.x == 0 && threadIdx.x == 0) *pass.started = clock_ns();
}
