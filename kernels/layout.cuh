// What the host and the kernels share: twins of src/cuda/layout.rs.
#pragma once
#include <stddef.h>
#include <stdint.h>
#include "contact.cuh"
#include "efg.cuh"

// Nodes of a brick along x, y, z, and in all.
constexpr int BRICK_X = 8, BRICK_Y = 4, BRICK_Z = 4, BRICK_NODES = BRICK_X * BRICK_Y * BRICK_Z;

// What a cell of one material contributes, SI units; see CellLaw in src/model/law.rs.
struct Law {
    float spring;
    float volume;
    float corner;
    float damper;
};

// Bits of Pass::flags: held along an axis each, and held by a tool.
constexpr uint32_t FIX_X = 1, FIX_Y = 2, FIX_Z = 4, GRASPED = 16;

// Most tools at once.
constexpr int MAX_TOOLS = 64;
// Most contact points at once; most sites of the surface that may become one before they are listed anew; most nodes that
// carry a site; and most sites to which one is coupled where points are few.
constexpr int MAX_POINTS = 2048, MAX_SITES = 8192, MAX_ROW = 24, MAX_COUPLED = 32;
// A site that nodes carry which are held along some axes alone: impulses do not move it alike along all of them.
constexpr uint32_t UNEVEN = ~0u;
// Bytes that contact's block shares beside what it declares: couplings between up to 64 points, five fields of those, and their impulses.
constexpr int CONTACT_SHARED_BYTES = 64 * (68 * 4 + 5 * 16 + 2 * 16 + 16);

// A tool during one step. Model frame.
struct ToolStep {
    double from[3], to[3];
    // Orientation at the start, and the rotation vector of the whole step.
    float turn_from[4];
    float turn[3];
    float friction;
    // Radius of a ball around the origin that holds the tool, how far a point may come before its way matters, and how far any of the tool's
    // own points goes.
    float radius, stride, reach;
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
    // What is left of a velocity after a substep's kick: by background drag, or one half from rest while the tissue settles.
    float keep;
    float gravity[3];
    uint32_t sequence;
    uint32_t tool_count;
    // How far from where a tool may be in this step the sites lie that are listed.
    float margin;
    // The step, in s.
    float duration;
    // Largest push in one substep beside the tools' own motion, in m.
    float push_limit;
    // Whether tissue may come so far in one substep that its way matters.
    uint32_t may_jump;
    // Sum of m v² at the end of the last substep; 0 where velocities were cleared. Kept up by the device while it settles.
    float vis_viva;
    ToolStep tools[MAX_TOOLS];
};

// What a substep saw in one brick; see Mark in src/cpu/lattice/mod.rs.
struct Mark {
    float speed2;
    float acceleration2;
    float vis_viva;
    float strain;
    float swelling;
    float shrinking;
};

// Places in Sleep::counts: bricks that are awake, sleeping ones beside them, and nodes in the former.
enum SleepCount { AWAKE, WATCHED, AWAKE_NODES, SLEEP_COUNTS };

// How a step went, written by the device into the host's memory; `sequence` last.
struct Report {
    // The substep, from 1, in which a node went further than a cell or nowhere finite; 0xffffffff if none did.
    uint32_t diverged_at;
    float speed2;
    float strain;
    float swelling;
    float shrinking;
    // Numbers of Sleep::counts; 0 where nothing may sleep.
    uint32_t awake[SLEEP_COUNTS];
    double vis_viva;
    uint32_t contact_points;
    uint32_t dropped_points;
    // Of an implicit step: all its iterations, and the share of its first residual that was left.
    uint32_t iterations;
    float residual;
    // How many points there are in Touched.
    uint32_t points;
    // From the start of the step's first kernel to now.
    uint64_t device_ns;
    ToolSum sums[MAX_TOOLS];
    uint32_t sequence;
};

// A piece of a divided cell: the slots of its eight nodes, its material, and its share of the cell's volume.
struct Piece {
    uint32_t nodes[8];
    uint32_t material;
    float volume;
};

// Bricks on which no piece hangs, and those with no node in a row, among places of those with one.
constexpr uint32_t NO_PLACE = ~0u;

// Pieces of divided cells. Nodes of bricks that they hang on have places of their own, 128 for each such brick.
struct Pieces {
    uint32_t count;
    const Piece* all;
    // What each gives to its nodes, in N; in the last word of those to the first three its strain, J − 1 and 1 − J.
    float4* given;  // [count][8]
    // Where each node's pieces begin, and one more; and those, times 8, with the corner by which they hang on it.
    const uint32_t* starts;
    const uint32_t* hung;
    // What pieces weigh at each node.
    const float* kg;
};

// Bricks that a kernel advances: all of them; or first those near tools, which contact follows, and then, while contact is at work, the rest.
enum Share { WHOLE, FIRST, REST };

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
    // Where the step's first kernel notes when it began, by the device's clock; null for all others.
    uint64_t* started;
    float cell;
    // This substep in its step, from 1.
    uint32_t substep;
    // Whether marks are wanted.
    uint32_t mark;
    // Which bricks advance: a Share.
    uint32_t share;
    // Bricks that may not sleep, for a tool is near them, or something else acts on them; and a list of the former, with how many they are in place of
    // those that are awake.
    uint32_t* near_tools;   // [bricks + 1]
    uint8_t* acted_on;      // [bricks + 1]
    uint32_t* near_bricks;  // [bricks]
    uint32_t* near_counts;  // [SLEEP_COUNTS]
    // Once cells were divided: the places of bricks among those that pieces hang on, and the pieces; null before.
    const uint32_t* piece_bricks;  // [bricks + 1]
    const Pieces* pieces;
};

// Which bricks sleep. What stands for every brick that is not there sleeps for ever.
struct Sleep {
    uint32_t bricks;
    // Below which a brick is quiet, squared; and above which a sleeping one wakes.
    float speed2, acceleration2, wake2;
    uint8_t* asleep;           // [bricks + 1]
    uint8_t* quiet;            // [bricks]: for how many substeps, 255 at most
    const uint8_t* nodes_in;   // [bricks]
    uint32_t* awake;           // [bricks]
    uint32_t* watched;         // [bricks]
    uint32_t* counts;
};

// Place of a slot's velocity along x; y and z follow at distances of BRICK_NODES.
PLP_LAW size_t velocity_at(uint32_t slot) { return size_t(slot / BRICK_NODES) * (3 * BRICK_NODES) + slot % BRICK_NODES; }

// What pieces of divided cells weigh at a node.
PLP_LAW float kg_of_pieces(const Pass& pass, uint32_t slot) {
    if (!pass.piece_bricks) return 0.0f;
    const uint32_t place = pass.piece_bricks[slot / BRICK_NODES];
    return place == NO_PLACE ? 0.0f : pass.pieces->kg[size_t(place) * BRICK_NODES + slot % BRICK_NODES];
}

// A node that loads push.
struct Pushed {
    uint32_t slot;
    // Its pressed faces: where they begin, and how many there are.
    uint32_t start, count;
    // Of loads that keep their direction, in N; and 1 / mass, zero along held axes.
    double force[3];
    double mobility[3];
};

// A pressed face: corners counter-clockwise seen from outside, the diagonals from the first two of them at rest, and the pressure in Pa.
struct Pressed {
    uint32_t corners[4];
    double diagonals[2][3];
    double pressure;
};

// All loads.
struct Push {
    uint32_t count;
    const Pushed* nodes;
    const Pressed* faces;  // node by node
};

// A node of a region that is driven.
struct Driven {
    double rest[3];
    uint32_t slot;
    // Its region's place among those that are driven.
    uint32_t region;
};

// What makes a displacement of a rest position: a rotation's matrix less the unit matrix, row by row, and a translation in m.
struct Motion {
    double turn[9];
    double way[3];
};

// All regions that are driven.
struct Drive {
    uint32_t count, regions;
    const Driven* nodes;
    const Motion* motions;  // [substeps][regions]: at the end of each substep
};

// A node that a tool holds.
struct Held {
    double rest[3];
    // Where it is in the tool's frame, in m; and its mass.
    float place[3];
    float mass;
    uint32_t slot;
};

// All nodes that tools hold.
struct Hold {
    uint32_t count, substeps;
    const Held* nodes;       // tool by tool
    const uint32_t* starts;  // [MAX_TOOLS + 1]: where each tool's begin
    ToolSum* sums;
};

// Places in Contact::counts: near elements, vertices and divided triangles; listed sites, the nodes that carry them, and their loads; what found no room;
// points, and how many of them push; and how often points were looked for.
enum Count { NEAR, SITES, CARRIERS, LOADS, DROPPED, POINTS, PUSHED, ROUND, COUNTS };

// A point of the surface inside a tool: four numbers a field, each an array over the points.
enum PointField {
    // Out of the tool; and how fast it must be pushed out in m/s, or, where held nodes alone carry it, minus its impulse.
    NORMAL,
    // From the tool's origin, model axes; and the depth.
    AT,
    // Whole numbers: tool and element. Then 0, and for how many iterations its impulse has gone the same way.
    NAMES,
    // Impulse on the tissue in N s, across the normal and along it.
    IMPULSE,
    // Velocity of the tissue without contact, seen from the tool, across the normal; and what an iteration makes an impulse of a velocity with: hardly more
    // than 1 / what all points together move this one by, at most.
    BEFORE,
    // The impulse of the last iteration, and how it differs from that of the one before.
    LAST,
    WAY,
    POINT_FIELDS,
};

// What the host is told of a point: its first fields.
constexpr int TOLD_FIELDS = BEFORE;
struct Touched {
    float4 fields[TOLD_FIELDS];
};

// A node that carries sites.
struct Carrier {
    uint32_t slot;
    // Its sites: where they begin among the loads, and how many there are.
    uint32_t start, count;
    // One of them; or, seen from a site, what this carrier is called, MAX_UINT where there is none.
    uint32_t name;
};

// A site on a carrier, or one that another is coupled to.
struct Load {
    uint32_t site;
    float weight;
};

// Contact of one surface. Sites are its vertices and the centres of small triangles, into which triangles are divided that are too long for a part of a
// tool: each part meets the sites that fit it. Elements are the vertices and, from a multiple of 32 on, the triangles.
struct Contact {
    uint32_t vertices, triangles, first_triangle;
    // Whether triangles may be divided.
    uint32_t divides;
    // Sites further apart than this share no node.
    float reach;
    const float* rest;          // [3 * vertices]
    const uint4* row_nodes;     // [2 * vertices]: slots
    const float4* row_weights;  // [2 * vertices]
    const uint32_t* corners;    // [3 * triangles]
    const Part* parts;
    // Longest edge of each triangle, and the least of those around a vertex.
    const float* triangle_edges;
    const float* vertex_edges;
    // Near elements: a bit each, which are zeros but while they are listed, their list, and each one's first site.
    uint32_t* near_bits;
    uint32_t* near;
    uint32_t* near_starts;
    // How the near triangles are divided: bit n - 1 stands for n parts of an edge.
    uint32_t* divisions;
    uint32_t* counts;
    // Sites: rest position, and the largest share of a node's mobility; mobility along the axes, and as if nothing were held.
    float4* site_rest;
    float4* site_own;
    float* site_edges;  // those by which it depends on a tool's part whether it meets them
    uint2* site_names;  // element, and into how many parts its edges are divided
    uint32_t* site_slots;     // [MAX_ROW][MAX_SITES]
    float* site_weights;      // [MAX_ROW][MAX_SITES]
    Carrier* site_carriers;   // [MAX_ROW][MAX_SITES]
    // To how many sites each is coupled, or UNEVEN; and, for those that are to no more than MAX_COUPLED: what an impulse on another changes of its
    // velocity, which is the same along all axes. Zeros fill the rest.
    uint32_t* site_coupled;
    Load* couplings;  // [MAX_SITES][MAX_COUPLED]
    // The carrier on each slot.
    uint32_t* carrier_at;  // [slots]
    Carrier* carriers;
    float4* mobility;  // along the axes, and 1 / mass
    Load* loads;
    // Loads on active sites, by what those are among the active ones; when each carrier was last claimed; carriers of points, and how many such loads each
    // has; and what impulses change of a carrier's velocity.
    Load* active_loads;
    uint32_t* claimed;
    uint2* moved;
    float4* changes;
    // Rows of active sites, by what their nodes are among those that move; impulses on them, where they are many.
    Load* active_rows;  // [MAX_POINTS][MAX_ROW]
    float4* impulses;   // [MAX_POINTS]
    // What points give to their tools: impulse, moment, work.
    double* given;  // [7][MAX_POINTS]
    float4* points;  // [POINT_FIELDS][MAX_POINTS]
    ToolSum* sums;
    Touched* touched;  // [MAX_POINTS], the host's memory
};

// Where and when a projection takes place.
struct Moment {
    // The fraction of the step at its start and end.
    float from, to;
    // Whether it begins the tools' sums; whether the tissue moved here, or only the tools; and whether this is the last move of the substep.
    uint32_t is_first, tissue_moves, is_last;
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
    const uint32_t* triangles;   // [3 * triangles]
    const uint2* fans;           // [vertices]: where the triangles at each start and end
    const uint32_t* triangle_of;
    float4* positions;
    float4* normals;
    float* scalars;
};

// What meshless cells of one material resist by, and what becomes of that in a step: times dt² + β dt.
struct EfgLaw {
    Moduli<double> forces, changes;
};

// How tissue answers to strain; see src/model/efg/law.rs.
enum Elasticity { COROTATED, LINEAR, ST_VENANT_KIRCHHOFF };

// What is new in each implicit step. Model frame, SI units; the record of the tools is its last part.
struct EfgStep {
    double dt;
    // What drag makes of a mass.
    double inertia;
    double gravity[3];
    // The share of the first residual that may be left.
    double tolerance;
    // A node that goes further is lost, in m.
    double furthest;
    // What bone resists by, in N/m.
    double wall;
    // The fraction of the tools' ways at the start and the end of the step, and how far from a tool a point may be that it may come to meet, in m.
    float from, to, reach;
    uint32_t max_iterations;
    // An Elasticity.
    uint32_t elasticity;
    // Whether b has A v₀ in place of M v₀; and whether no more is wanted than b.
    uint32_t is_paper, only_forces;
    // Which one of a step's it is, from 0.
    uint32_t substep;
    Step step;
};

// Numbers of a field that each brick has: of vectors, blocks on the diagonal, rotations and frames.
enum EfgNumbers { VECTOR = 3, BLOCK = 6, ROTATION = 4, FRAME = 9 };

// What contact keeps of each of its points, in single or double precision.
enum PressField {
    // Impulse per velocity, in kg: along the normal, and across it, now and as the last solution asks for.
    STIFFNESS,
    GRIP,
    NEXT_GRIP,
    // Whether it is pushed at all, now and then.
    IS_PUSHED,
    NEXT_IS_PUSHED,
    // Velocity along the normal that puts it out.
    WANTED,
    // Of active sites: how they move, and what their points answer to that.
    MOVING,
    ANSWER = MOVING + 3,
    PRESS_FIELDS = ANSWER + 3,
};

// Places of a row.
constexpr int ROW = 20;

// A cell with a row of its own: V, and 8 V / h³.
template <class R>
struct RowCell {
    R volume, fill;
    uint32_t length, material;
};

// A node in its row: ∇φ, w / Σ w, and where it lies from the weighted mean.
template <class R>
struct RowEntry {
    R gradient[3], share, arm[3];
    uint32_t slot;
};

// Where a node stands.
struct RowPlace {
    uint32_t row, entry;
};

// Two pieces face to face across a wall: the nodes of either, their weights at its middle, 1 / mass of each, and the wall's normal at rest, from the second to the first.
struct Facing {
    uint32_t nodes[2][8];
    double weights[8];
    double inverse_kg[2][8];
    double normal[3];
};

// The sides of cuts, cell by cell; null where there are none.
struct Sides {
    const Facing* all;
    // Where the pairs of each cell begin, and one more; and where among cells each class of those begins that share no node, and one more.
    const uint32_t* cells;
    const uint32_t* classes;
};

// A point of a blade's edge in tissue: nodes of its cell, their weights there, and 1 / mass of each; where it is, and the direction of the edge, in the tool's frame; and the force
// at which the tissue gives way, in N.
struct Stuck {
    uint32_t nodes[8];
    double weights[8], inverse_kg[8];
    double limit;
    float at[3], along[3];
    uint32_t tool;
};

// What happens to one in a substep: how fast an impulse on it makes its nodes, and where they were and how fast; where it is from the tool's origin, the direction of the edge, how fast that goes,
// and how fast an impulse makes the point at most; and the impulse that it gets.
struct Pull {
    double by[8][3], u[8][3], v[8][3];
    double arm[3], along[3], goes[3], gives;
    double impulse[3];
};

// What one does inside an implicit step: the direction of the edge, and how fast that goes; the impulse per slip where it sticks, in kg, and that above which tissue gives way; what the tissue received, and what it
// gets where it slips; how the point moves, and what it answers to that; whether it sticks, and whether the last solution asks for that.
struct EdgePoint {
    double along[3], velocity[3], stiffness, most;
    double impulse[3], next[3], moving[3], answer[3];
    uint32_t sticks, next_sticks;
};

// A node that carries points of edges, and where its loads begin; a point, and its node's weight there.
struct EdgeCarrier {
    uint32_t slot, start, count;
};
struct EdgeLoad {
    double weight;
    uint32_t point;
};

// All of them, tool by tool; null where there are none. The last five are the meshless model's, and `carrier_at` says of a slot which carrier it is, counted from 1.
struct Sticks {
    const Stuck* all;
    Pull* pulls;
    const uint32_t* count;
    ToolSum* sums;
    EdgePoint* points;
    const EdgeCarrier* carriers;
    const uint32_t* carrier_count;
    const EdgeLoad* loads;
    uint32_t* carrier_at;
    uint32_t substeps;
    // Whether nothing has begun the tools' sums before.
    uint32_t begins;
};

// A node that a cut has made, and the one that it was.
struct Birth {
    uint32_t slot, from;
};

// A node that has other whole cells around it.
struct Reworded {
    uint32_t slot, word;
};

// A row that is turned as another one, or as the cell that starts at a slot.
struct Turned {
    uint32_t row, from, is_row;
};

// What a cut changes of the nodes.
struct Cut {
    uint32_t births, words, turns;
    const Birth* born;
    const Reworded* reworded;
    const Turned* turned;
    // Displacements and words, and fields of three numbers for each node; null where there are fewer.
    float4* u[2];
    void* vectors[2];
    // Of cells, and of rows.
    const void* rotations;
    void* row_rotations;
};

// How far apart displacements of bricks, of a node along two axes, and of two nodes are, in numbers.
struct Places {
    uint32_t brick, axis, node;
};

// A look at where nodes are.
struct Look {
    Places places;
    const void* u;
    const uint32_t* nodes;  // [brick][BRICK_NODES / 32]: a bit for each that is there
    void* seen;             // [brick][axis][node]: where they are
    void* bounds;           // [brick][6]
};

// What was seen of some bricks.
struct Shown {
    const uint32_t* bricks;
    const void* seen[2];  // at the look before the last one, and at that
    void* nodes;          // [place in the list][look][axis][node]
};

// Most numbers that blocks of a grid sum up at once.
constexpr int GRID_NUMBERS = 4;

// Bytes that a block of the step's kernel shares, and those that each of its teams adds.
template <class R>
constexpr size_t EFG_BLOCK_BYTES = GRID_NUMBERS * 33 * 8 + 96 * sizeof(R);
template <class R>
constexpr size_t EFG_TEAM_BYTES = 3780 * sizeof(R);

// The meshless state and its system, A x = b; see src/cpu/efg/system.rs. Arrays whose type is not named are of float or double, `numbers` of which each brick
// has for each of its nodes: [brick][number][node]. Behind the last brick lies one of zeros, which stands for every brick that is not there.
struct Efg {
    uint32_t bricks;
    // Whether this kernel is the step's first.
    uint32_t starts;
    // How many cells have rows of their own.
    uint32_t row_count;
    // Whether a kernel follows that ends the step, and tells its number.
    uint32_t is_followed;
    double cell;
    EfgStep* step;
    const EfgLaw* laws;         // [16]
    const uint32_t* neighbours;  // 27 for each brick, x fastest
    const uint8_t* flags;
    // Materials of cells, by their lowest corners.
    const uint8_t* cells;
    // Displacements and words, for what knows no model.
    float4* shown;
    const void* mass;
    // What a node's own motion meets in A without what its cells see of it.
    void* heavy;
    void* inverse;
    void* rotations;
    void* frames;
    void *u, *v, *x, *b;
    // Residual, that preconditioned, direction, A times these two, and A times x.
    void *r, *z, *p, *w, *s, *ax;
    // What contact adds to A times a vector, three numbers for each carrier; and how much all points together put on it.
    void* touched;
    void* shares;
    void* press;  // [PRESS_FIELDS][MAX_POINTS]
    // At how many meetings blocks have been in all steps before, and how often they have arrived, all together; sums of blocks, in turn; and the largest strains that they saw.
    uint32_t *meetings, *arrived;
    double* partials;
    float4* seen;
    // Whether contact answered as it was asked.
    uint32_t* is_settled;
    // Bricks with nodes that carry listed sites.
    const uint32_t* near_tools;
    // When the step began, by the device's clock.
    uint64_t* started;
    // Cells with rows of their own; the places of bricks among those with nodes in rows; and where these nodes' parts of `row_places` begin, and one more. See
    // src/cpu/efg/rows.rs.
    const void* row_cells;       // RowCell
    const void* row_entries;     // RowEntry: [rows][ROW]
    const uint32_t* row_bricks;  // [bricks]
    const uint32_t* row_starts;
    const RowPlace* row_places;
    void *row_rotations, *row_frames;
    // What each node of a row receives.
    void* row_given;
    Report* report;
};
