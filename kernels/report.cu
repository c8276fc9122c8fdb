// The end of a step: one block sums up what the last substep's marks say and tells the host.
#include <stddef.h>
#include "clock.cuh"
#include "layout.cuh"
#include "touched.cuh"

namespace report_kernel {

// Numbers of a mark. Threads read four numbers each, side by side; as their count is a multiple of a mark's numbers, a thread meets
// the same four fields in every round.
constexpr uint32_t FIELDS = sizeof(Mark) / sizeof(float), THREADS = 96 * FIELDS, SEEN = 4 * THREADS / FIELDS;
constexpr uint32_t VIS_VIVA = offsetof(Mark, vis_viva) / sizeof(float);
// The report before the tools' sums, and a tool's sums.
constexpr uint32_t HEAD = offsetof(Report, sums) / sizeof(uint32_t), SUMS = sizeof(ToolSum) / sizeof(double);
static_assert(sizeof(Mark) == FIELDS * sizeof(float) && THREADS % 32 == 0 && THREADS / 32 > FIELDS && HEAD <= 32 && SUMS * MAX_TOOLS <= THREADS);

// The largest of `SEEN` numbers of a field, as a warp finds it.
__device__ float largest(const float* numbers, uint32_t lane) {
    float most = 0.0f;
    for (uint32_t i = lane; i < SEEN; i += 32) most = fmaxf(most, numbers[i * FIELDS]);
    for (int step = 16; step > 0; step /= 2) most = fmaxf(most, __shfl_xor_sync(~0u, most, step));
    return most;
}

// Their sum, in a fixed order.
__device__ double total(const double* sums, uint32_t lane) {
    double sum = 0.0;
    for (uint32_t i = lane; i < SEEN; i += 32) sum += sums[i];
    for (int step = 16; step > 0; step /= 2) sum += __shfl_xor_sync(~0u, sum, step);
    return sum;
}

}  // namespace report_kernel
using namespace report_kernel;

// `marks` has room for a multiple of four of them, zeros behind the last; `quads` is a quarter of their numbers.
extern "C" __global__ void __launch_bounds__(THREADS) report(const float4* __restrict__ marks, uint32_t quads, const Step* step, uint32_t* diverged_at,
                                                             const uint64_t* started, const uint32_t* contact, const float4* points,
                                                             const ToolSum* sums, const uint32_t* awake, Touched* touched, Report* report) {
    __shared__ float4 largest_of[THREADS];
    __shared__ double sum_of[SEEN];
    // What goes to the host at once, in one write.
    alignas(Report) __shared__ uint32_t head[HEAD];
    Report* const told = reinterpret_cast<Report*>(head);
    const uint32_t me = threadIdx.x, lane = me & 31, warp = me / 32, sequence = step->sequence, tools = step->tool_count;
    if (me < SUMS * tools) reinterpret_cast<double*>(report->sums)[me] = reinterpret_cast<const double*>(sums)[me];
    const uint32_t touching = tools ? contact[POINTS] : 0;
    if (touched) tell_points(points, touching, touched);
    uint64_t began = 0;
    if (me == THREADS - 1) {
        began = *started;
        told->diverged_at = *diverged_at;
        told->contact_points = tools ? contact[PUSHED] : 0;
        told->dropped_points = contact[DROPPED];
        told->iterations = 0;
        told->residual = 0.0f;
        told->points = touching;
        for (int i = 0; i < SLEEP_COUNTS; ++i) told->awake[i] = awake[i];
        *diverged_at = ~0u;
    }

    float4 most{};
    double sum = 0.0;
    // Which of the four numbers is the vis viva, if any is.
    const uint32_t summed = (VIS_VIVA + FIELDS - 4 * me % FIELDS) % FIELDS;
#pragma unroll 4
    for (uint32_t i = me; i < quads; i += THREADS) {
        const float4 m = marks[i];
        most = make_float4(fmaxf(most.x, m.x), fmaxf(most.y, m.y), fmaxf(most.z, m.z), fmaxf(most.w, m.w));
        sum += summed == 0 ? m.x : summed == 1 ? m.y : summed == 2 ? m.z : summed == 3 ? m.w : 0.0f;
    }
    largest_of[me] = most;
    if (summed < 4) sum_of[(4 * me + summed) / FIELDS] = sum;
    __syncthreads();

    if (warp == VIS_VIVA) {
        const double all = total(sum_of, lane);
        if (lane == 0) told->vis_viva = all;
    } else if (warp < FIELDS) {
        const float all = largest(reinterpret_cast<const float*>(largest_of) + warp, lane);
        if (lane == 0) {
            switch (warp * sizeof(float)) {
                case offsetof(Mark, speed2): told->speed2 = all; break;
                case offsetof(Mark, strain): told->strain = all; break;
                case offsetof(Mark, swelling): told->swelling = all; break;
                case offsetof(Mark, shrinking): told->shrinking = all; break;
            }
        }
    }
    if (me == THREADS - 1) told->device_ns = clock_ns() - began;
    __syncthreads();
    if (warp == 0) {
        if (lane < HEAD) reinterpret_cast<uint32_t*>(report)[lane] = head[lane];
        __syncwarp();
        if (lane == 0) {
            // The host reads the rest once it sees the number.
            __threadfence_system();
            *(volatile uint32_t*)&report->sequence = sequence;
        }
    }
}
