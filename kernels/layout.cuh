// What the host and the kernels share: twins of src/cuda/layout.rs.
#pragma once
#include <stdint.h>
#include "contact.cuh"

// Nodes of a brick along x, y, z, and in all.
constexpr int BRICK_X = 8, BRICK_Y = 4, BRICK_Z = 4, BRICK_NODES = BRICK_X * BRICK_Y * BRICK_Z;

// What a cell of one material contributes, SI units; see CellLaw in src/model/law.rs.
struct Law {
    float spring;
    float volume;
    float corner;
    float damper;
};

// Most tools at once.
constexpr int MAX_TOOLS = 64;
// Most contact points at once on any device, most vertices that may become one in a step, and most nodes that carry those.
constexpr int MAX_POINTS = 2048, MAX_NEAR = 8192, MAX_NODES = 8 * MAX_NEAR;

// A tool during one step. Model frame.
struct ToolStep {
    double from[3], to[3];
    // Orientation at the start, and the rotation vector of the whole step.
    float turn_from[4];
    float turn[3];
    float friction;
    // Radius of a ball around the origin that holds the tool, and the distance that contact points resolve.
    float radius, spacing;
    // Its parts among all.
    uint32_t part, part_count;
};

// What a tool gave to the tissue in a step: impulse on the tool and its moment about the tool's origin, and the work on the tissue.
struct ToolSum {
    double impulse[3], moment[3], work;
};

// What is new in each step. Model frame, SI units; `tools` follow in the same record.
struct Step {
    float dt;
    // What background drag leaves of a velocity.
    float keep;
    float gravity[3];
    uint32_t sequence;
    uint32_t tool_count;
    // How much further than a tool's own way the tissue may come to meet it in this step.
    float margin;
    // The step, in s.
    float duration;
    // Largest push in one substep beside the tools' own motion, in m.
    float push_limit;
    // Whether tissue may come so far in one substep that its way matters.
    uint32_t may_jump;
    uint32_t reserved;
    ToolStep tools[MAX_TOOLS];
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
    uint32_t contact_points;
    uint32_t dropped_points;
    ToolSum sums[MAX_TOOLS];
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

// A point of the surface inside a tool: places of its fields, each an array over the points.
enum PointField {
    VERTEX,
    TOOL,
    // The next tool's point on the same vertex.
    NEXT,
    // 0 where held nodes alone carry it.
    IS_MOVABLE,
    // From the tool's origin, model axes.
    AT,
    DEPTH = AT + 3,
    // Out of the tool.
    NORMAL,
    // How fast it must be pushed out, m/s.
    TARGET = NORMAL + 3,
    TOOL_VELOCITY,
    // 1 / what all points together move this one by, at most.
    MASS = TOOL_VELOCITY + 3,
    // Velocity of the tissue without contact, seen from the tool.
    BEFORE,
    // Impulse on the tissue in N s, along the normal and across it; and that of the last iteration.
    PUSH = BEFORE + 3,
    DRAG,
    LAST_PUSH = DRAG + 3,
    LAST_DRAG,
    NODE = LAST_DRAG + 3,
    WEIGHTS = NODE + 8,
    POINT_FIELDS = WEIGHTS + 8,
};

// Contact of one surface.
struct Contact {
    uint32_t vertices;
    // Most contact points, and most nodes that carry them: what the device's shared memory holds.
    uint32_t max_points, max_touched;
    const float* rest;          // [3 * vertices]
    const uint4* row_nodes;     // [2 * vertices]: slots
    const float4* row_weights;  // [2 * vertices]
    const Part* parts;
    // Near vertices: a bit each, and their list.
    uint32_t* near_bits;
    uint32_t* near;
    uint32_t* counts;  // near, nodes, dropped, points, tag, pushed points
    // Nodes that carry near vertices: slot, mobility along the axes and inverse mass.
    uint32_t* node_stamp;  // [slots]
    uint32_t* node_of;     // [slots]
    uint32_t* nodes;
    float4* mobility;
    uint32_t* node_tag;
    uint32_t* touched_at;
    // Nodes that carry points, and for each the points: ranges [max_touched + 1], and point and weight.
    uint32_t* touched;
    float4* touched_mobility;
    uint32_t* entry_start;
    uint2* entries;
    // The first point on each vertex, at the time that the tag names.
    uint32_t* head_tag;
    uint32_t* head;
    float* points;  // [2][POINT_FIELDS][MAX_POINTS]
    ToolSum* sums;
};

// From the model's frame to the world's: a rotation matrix, row by row, and the edge of a cell in m.
struct Frame {
    float turn[9];
    float cell;
};

// A surface that is shown. World frame.
struct Surface {
    uint32_t vertices;
    // Whether the scalar is the strain; else the displacement.
    uint32_t strain;
    Frame frame;
    const float4* u;
    const float* rest;           // [3 * vertices]
    const uint32_t* row_nodes;   // [8 * vertices]
    const float* row_weights;    // [8 * vertices]
    const uint32_t* cells;       // [8 * vertices]; ~0 where there is none
    const uint32_t* triangles;   // [3 * triangles]
    const uint32_t* triangle_starts;
    const uint32_t* triangle_of;
    float4* positions;
    float4* normals;
    float* scalars;
};
