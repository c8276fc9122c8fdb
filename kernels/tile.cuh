// A brick and the one-node halo around it, as they are staged in shared memory.
#pragma once
#include "layout.cuh"

// The staged tile: brick and halo.
constexpr int TILE_X = BRICK_X + 2, TILE_Y = BRICK_Y + 2, TILE_Z = BRICK_Z + 2;
constexpr int TILE = TILE_X * TILE_Y * TILE_Z;
constexpr int HALO = TILE - BRICK_NODES;
// Cells that touch a node of the brick.
constexpr int CELLS_X = BRICK_X + 1, CELLS_Y = BRICK_Y + 1, CELLS_Z = BRICK_Z + 1;
constexpr int CELLS = CELLS_X * CELLS_Y * CELLS_Z;
// How often a thread for each node of the brick has to do what is done for each node of the halo, or each cell.
constexpr int HALO_ROUNDS = (HALO + BRICK_NODES - 1) / BRICK_NODES, CELL_ROUNDS = (CELLS + BRICK_NODES - 1) / BRICK_NODES;

__host__ __device__ constexpr int tile_at(int x, int y, int z) { return (z * TILE_Y + y) * TILE_X + x; }

// Where each halo node lies: its place in the tile, which of the 27 bricks it is in, and its place there.
struct HaloTable {
    uint32_t entry[HALO];
};
constexpr HaloTable halo_table() {
    HaloTable table{};
    int count = 0;
    for (int z = 0; z < TILE_Z; ++z) {
        for (int y = 0; y < TILE_Y; ++y) {
            for (int x = 0; x < TILE_X; ++x) {
                const int bx = (x + BRICK_X - 1) / BRICK_X, by = (y + BRICK_Y - 1) / BRICK_Y, bz = (z + BRICK_Z - 1) / BRICK_Z;
                const int brick = bx + 3 * by + 9 * bz;
                if (brick == 13) continue;
                const int nx = (x + BRICK_X - 1) % BRICK_X, ny = (y + BRICK_Y - 1) % BRICK_Y, nz = (z + BRICK_Z - 1) % BRICK_Z;
                const int node = (nz * BRICK_Y + ny) * BRICK_X + nx;
                table.entry[count++] = tile_at(x, y, z) | brick << 9 | node << 14;
            }
        }
    }
    return table;
}
// External, so that no name in the image depends on where it was compiled.
extern __device__ const HaloTable HALO_TABLE;
__device__ const HaloTable HALO_TABLE = halo_table();
