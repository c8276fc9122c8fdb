// What the host is told of the points in contact.
#pragma once
#include "layout.cuh"

// Writes them into the host's memory, a number each thread of a block.
__device__ inline void tell_points(const float4* points, uint32_t count, Touched* touched) {
    for (uint32_t i = threadIdx.x; i < TOLD_FIELDS * count; i += blockDim.x) {
        touched[i / TOLD_FIELDS].fields[i % TOLD_FIELDS] = points[i % TOLD_FIELDS * MAX_POINTS + i / TOLD_FIELDS];
    }
}
