// What loads do to a node, and where driven regions take one: in double precision, for there are few.
#pragma once
#include "layout.cuh"

struct Triple {
    double x, y, z;
};

// What all loads together do to a node, in N; `moved` says by how much a slot's node has moved.
template <class Moved>
__device__ __forceinline__ Triple force_on(const Push& loads, const Pushed& node, Moved moved) {
    Triple force{node.force[0], node.force[1], node.force[2]};
    for (uint32_t f = node.start; f < node.start + node.count; ++f) {
        const Pressed face = loads.faces[f];
        Triple d[2];
        for (int i = 0; i < 2; ++i) {
            const Triple a = moved(face.corners[i]), b = moved(face.corners[i + 2]);
            d[i] = {face.diagonals[i][0] + b.x - a.x, face.diagonals[i][1] + b.y - a.y, face.diagonals[i][2] + b.z - a.z};
        }
        // The vector area is half the product of the diagonals; each corner bears a quarter.
        const double share = 0.125 * face.pressure;
        force.x -= share * (d[0].y * d[1].z - d[0].z * d[1].y);
        force.y -= share * (d[0].z * d[1].x - d[0].x * d[1].z);
        force.z -= share * (d[0].x * d[1].y - d[0].y * d[1].x);
    }
    return force;
}

// The displacement of a driven node.
__device__ __forceinline__ Triple place_of(const Driven& node, const Motion& motion) {
    const auto along = [&](int axis) {
        const double* const row = motion.turn + 3 * axis;
        return row[0] * node.rest[0] + (row[1] * node.rest[1] + row[2] * node.rest[2]) + motion.way[axis];
    };
    return {along(0), along(1), along(2)};
}
