// What the meshless model is compared with on a GPU: the flow of data of Magnoux and Ozell 2021. Rows of all elements lie in whole arrays, elements distribute what they
// answer to nodes, and the host decides after each sum. One thread for each element, or for each node.

#include <cstdint>

namespace baseline_kernel {

// λ and 2 μ times the element's volume, in N m.
struct Stiffness {
    float lambda, two_mu;
};

// A sphere, centre and radius, what it pushes by in N/m, and the sum of what it felt.
struct Tool {
    float centre[3];
    float radius, stiffness;
    float felt[3];
};

// A block's sum is added to one number.
__device__ void add_up(double mine, double* sum) {
    __shared__ double of_warp[8];
    for (int step = 16; step > 0; step /= 2) mine += __shfl_down_sync(~0u, mine, step);
    if (threadIdx.x % 32 == 0) of_warp[threadIdx.x / 32] = mine;
    __syncthreads();
    if (threadIdx.x > 0) return;
    for (int warp = 1; warp < 8; ++warp) mine += of_warp[warp];
    atomicAdd(sum, mine);
}

}  // namespace baseline_kernel
using namespace baseline_kernel;

// Algorithm 2: adds `factor` times what stress of the motion p makes elements give to their nodes. Arrays lie [place][element], so that threads read side by side.
extern "C" __global__ void __launch_bounds__(256)
    distribute(uint32_t elements, const uint8_t* __restrict__ lengths, const uint32_t* __restrict__ nodes, const float* __restrict__ gradients,
               const Stiffness* __restrict__ stiffness, float factor, const float* __restrict__ p, float* q) {
    const uint32_t e = blockIdx.x * blockDim.x + threadIdx.x;
    if (e >= elements) return;
    const uint32_t length = lengths[e];
    float g[3][3] = {};
    for (uint32_t k = 0; k < length; ++k) {
        const uint32_t node = nodes[k * elements + e];
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) g[i][j] += p[3 * node + i] * gradients[(3 * k + j) * elements + e];
        }
    }
    const Stiffness by = stiffness[e];
    const float pressure = by.lambda * (g[0][0] + g[1][1] + g[2][2]), half = 0.5f * by.two_mu;
    float stress[3][3];
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) stress[i][j] = factor * (half * (g[i][j] + g[j][i]) + (i == j ? pressure : 0.0f));
    }
    for (uint32_t k = 0; k < length; ++k) {
        const uint32_t node = nodes[k * elements + e];
        float along[3];
        for (int j = 0; j < 3; ++j) along[j] = gradients[(3 * k + j) * elements + e];
        for (int i = 0; i < 3; ++i) atomicAdd(&q[3 * node + i], stress[i][0] * along[0] + stress[i][1] * along[1] + stress[i][2] * along[2]);
    }
}

// Weight and the tool's springs, times dt: what `distribute` adds to.
extern "C" __global__ void __launch_bounds__(256)
    push(uint32_t nodes, const float* __restrict__ mass, const float* __restrict__ rest, const float* __restrict__ u, float fall, float dt, Tool* tool, float* r) {
    const uint32_t n = blockIdx.x * blockDim.x + threadIdx.x;
    if (n >= nodes) return;
    float d[3], distance2 = 0.0f;
    for (int i = 0; i < 3; ++i) d[i] = rest[3 * n + i] + u[3 * n + i] - tool->centre[i], distance2 += d[i] * d[i];
    const float distance = sqrtf(distance2), deep = tool->radius - distance;
    const float push = deep > 0.0f ? tool->stiffness * deep / distance : 0.0f;
    for (int i = 0; i < 3; ++i) {
        r[3 * n + i] = dt * (push * d[i] - (i == 2 ? fall * mass[n] : 0.0f));
        if (push > 0.0f) atomicAdd(&tool->felt[i], -push * d[i]);
    }
}

// The first residual: nothing where nodes are held. x = 0, p = r, q = M p, and r·r.
extern "C" __global__ void __launch_bounds__(256)
    begin(uint32_t nodes, const float* __restrict__ mass, const uint8_t* __restrict__ held, float* r, float* x, float* p, float* q, double* sums) {
    const uint32_t n = blockIdx.x * blockDim.x + threadIdx.x;
    double rr = 0.0;
    for (int i = 0; n < nodes && i < 3; ++i) {
        const float left = held[n] ? 0.0f : r[3 * n + i];
        r[3 * n + i] = p[3 * n + i] = left;
        x[3 * n + i] = 0.0f;
        q[3 * n + i] = mass[n] * left;
        rr += double(left) * left;
    }
    add_up(rr, &sums[0]);
}

// p·q.
extern "C" __global__ void __launch_bounds__(256) multiply(uint32_t nodes, const float* __restrict__ p, const float* __restrict__ q, double* sums) {
    const uint32_t n = blockIdx.x * blockDim.x + threadIdx.x;
    double pq = 0.0;
    for (int i = 0; n < nodes && i < 3; ++i) pq += double(p[3 * n + i]) * q[3 * n + i];
    add_up(pq, &sums[1]);
}

// x += α p and r −= α q, and r·r.
extern "C" __global__ void __launch_bounds__(256) descend(uint32_t nodes, const uint8_t* __restrict__ held, float alpha, const float* __restrict__ p,
                                                          const float* __restrict__ q, float* x, float* r, double* sums) {
    const uint32_t n = blockIdx.x * blockDim.x + threadIdx.x;
    double rr = 0.0;
    for (int i = 0; n < nodes && i < 3; ++i) {
        x[3 * n + i] += alpha * p[3 * n + i];
        const float left = held[n] ? 0.0f : r[3 * n + i] - alpha * q[3 * n + i];
        r[3 * n + i] = left;
        rr += double(left) * left;
    }
    add_up(rr, &sums[0]);
}

// p = r + β p and q = M p.
extern "C" __global__ void __launch_bounds__(256) turn(uint32_t nodes, const float* __restrict__ mass, float beta, const float* __restrict__ r, float* p, float* q) {
    const uint32_t n = blockIdx.x * blockDim.x + threadIdx.x;
    if (n >= nodes) return;
    for (int i = 0; i < 3; ++i) {
        const float to = r[3 * n + i] + beta * p[3 * n + i];
        p[3 * n + i] = to;
        q[3 * n + i] = mass[n] * to;
    }
}

// v += x and u += dt v.
extern "C" __global__ void __launch_bounds__(256) go(uint32_t nodes, float dt, const float* __restrict__ x, float* v, float* u) {
    const uint32_t n = blockIdx.x * blockDim.x + threadIdx.x;
    if (n >= nodes) return;
    for (int i = 0; i < 3; ++i) {
        v[3 * n + i] += x[3 * n + i];
        u[3 * n + i] += dt * v[3 * n + i];
    }
}
