// The end of a step: one block sums up what the last substep's marks say and tells the host.
#include "layout.cuh"

namespace report_kernel {

constexpr int THREADS = 1024;

struct Total {
    float speed2, displacement2, strain, swelling, shrinking;
    double vis_viva;
};

__device__ void join(Total& a, const Total& b) {
    a.speed2 = fmaxf(a.speed2, b.speed2);
    a.displacement2 = fmaxf(a.displacement2, b.displacement2);
    a.strain = fmaxf(a.strain, b.strain);
    a.swelling = fmaxf(a.swelling, b.swelling);
    a.shrinking = fmaxf(a.shrinking, b.shrinking);
    a.vis_viva += b.vis_viva;
}

}  // namespace report_kernel
using namespace report_kernel;

extern "C" __global__ void __launch_bounds__(THREADS)
    report(const Mark* marks, uint32_t count, const Step* step, uint32_t* diverged_at, const uint32_t* contact, const ToolSum* sums, Report* report) {
    __shared__ Total totals[THREADS];
    Total mine{};
    for (uint32_t i = threadIdx.x; i < count; i += THREADS) {
        const Mark m = marks[i];
        join(mine, Total{m.speed2, m.displacement2, m.strain, m.swelling, m.shrinking, m.vis_viva});
    }
    totals[threadIdx.x] = mine;
    for (int half = THREADS / 2; half > 0; half /= 2) {
        __syncthreads();
        if (threadIdx.x < half) join(totals[threadIdx.x], totals[threadIdx.x + half]);
    }
    if (threadIdx.x == 0) {
        const Total all = totals[0];
        report->diverged_at = *diverged_at;
        report->speed2 = all.speed2;
        report->strain = all.strain;
        report->swelling = all.swelling;
        report->shrinking = all.shrinking;
        report->displacement2 = all.displacement2;
        report->vis_viva = all.vis_viva;
        report->dropped_points = contact[DROPPED];
        report->contact_points = step->tool_count ? contact[PUSHED] : 0;
        for (uint32_t t = 0; t < step->tool_count; ++t) report->sums[t] = sums[t];
        *diverged_at = ~0u;
        // The host reads the rest once it sees the number.
        __threadfence_system();
        *(volatile uint32_t*)&report->sequence = step->sequence;
    }
}
