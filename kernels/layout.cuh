// What the host and the kernels share: twins of src/cuda/layout.rs.
#pragma once
#include <stdint.h>

// Nodes of a brick along x, y, z, and in all.
constexpr int BRICK_X = 8, BRICK_Y = 4, BRICK_Z = 4, BRICK_NODES = BRICK_X * BRICK_Y * BRICK_Z;

// What a cell of one material contributes, SI units; see CellLaw in src/model/law.rs.
struct Law {
    float spring;
    float volume;
    float corner;
    float damper;
};

// What is new in each step. Model frame, SI units.
struct Step {
    float dt;
    // What background drag leaves of a velocity.
    float keep;
    float gravity[3];
    uint32_t sequence;
};

// What a substep saw in one brick; see Mark in src/cpu/lattice/mod.rs.
struct Mark {
    float speed2;
    float acceleration2;
    float displacement2;
    float vis_viva;
    float strain;
    float swelling;
    float shrinking;
};

// How a step went, written by the device into the host's memory; `sequence` last.
struct Report {
    // The substep, from 1, in which a node went further than a cell or nowhere finite; 0xffffffff if none did.
    uint32_t diverged_at;
    float speed2;
    float strain;
    float swelling;
    float shrinking;
    float displacement2;
    double vis_viva;
    uint32_t sequence;
};

// The fields of one simulation on the device. `u` holds displacement and, in its last word, the node's eight cell materials;
// behind the last brick lies one of zeros, which stands for every brick that is not there.
struct Pass {
    const float4* u;
    float4* u_next;
    // [brick][component][node].
    const float* v;
    float* v_next;
    // 27 for each brick, x fastest.
    const uint32_t* neighbours;
    const uint8_t* flags;
    const Law* laws;
    const Step* step;
    Mark* marks;
    uint32_t* diverged_at;
    // Bricks to advance; all in their order where this is null.
    const uint32_t* awake;
    float cell;
    // This substep in its step, from 1.
    uint32_t substep;
    // Whether marks are wanted.
    uint32_t mark;
};
