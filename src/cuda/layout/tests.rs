//! What a C++ compiler makes of `kernels/layout.cuh`.

use std::mem::offset_of;

use super::*;
use crate::cpu::efg::rows;
use crate::cuda::twins;
use crate::model::efg::rows::ROW;
use crate::model::lattice::{BRICK_SLOTS, flag};

/// For each struct its name and what must hold of it in C++. A field that is forgotten here does not compile.
macro_rules! claims {
    ($($name:ident { $($field:ident),* })*) => {
        [$({
            let _ = |value: $name| { let $name { $($field: _),* } = value; };
            let name = stringify!($name);
            let offsets = [$((stringify!($field), offset_of!($name, $field))),*];
            let claims = [format!("sizeof({name}) == {}", size_of::<$name>())].into_iter().chain(
                offsets.iter().map(|(field, at)| format!("offsetof({name}, {field}) == {at}")));
            (name, claims.collect::<Vec<_>>())
        }),*]
    };
}

#[test]
fn structs_and_numbers_that_kernels_share_are_the_same_on_both_sides() {
    let structs = claims! {
        Law { spring, volume, corner, damper }
        Part { turn, at, shape, size }
        ToolStep { from, to, turn_from, turn, friction, radius, stride, reach, part, part_count }
        ToolSum { impulse, moment, work }
        Step {
            dt, keep, gravity, sequence, tool_count, margin, duration, push_limit, may_jump, vis_viva, tools
        }
        Report {
            diverged_at, speed2, strain, swelling, shrinking, awake, vis_viva, contact_points,
            dropped_points, iterations, residual, points, device_ns, sums, sequence
        }
        Pass {
            u, u_next, v, v_next, neighbours, flags, laws, step, marks, diverged_at, started, cell, substep,
            mark, share, near_tools, acted_on, near_bricks, near_counts, piece_bricks, pieces
        }
        Piece { nodes, material, volume }
        Pieces { count, all, given, starts, hung, kg }
        Sleep { bricks, speed2, acceleration2, wake2, asleep, quiet, nodes_in, awake, watched, counts }
        Pushed { slot, start, count, force, mobility }
        Pressed { corners, diagonals, pressure }
        Push { count, nodes, faces }
        Driven { rest, slot, region }
        Motion { turn, way }
        Drive { count, regions, nodes, motions }
        Held { rest, place, mass, slot }
        Hold { count, substeps, nodes, starts, sums }
        Touched { fields }
        Carrier { slot, start, count, name }
        Load { site, weight }
        Contact {
            vertices, triangles, first_triangle, divides, reach, rest, row_nodes, row_weights, corners, parts,
            triangle_edges, vertex_edges, near_bits, near, near_starts, divisions, counts, site_rest, site_own, site_edges, site_names, site_slots, site_weights, site_carriers,
            site_coupled, couplings, carrier_at, carriers, mobility, loads, active_loads, claimed, moved, changes, active_rows, impulses, given, points,
            sums, touched
        }
        Moment { from, to, is_first, tissue_moves, is_last }
        Frame { turn, cell }
        Surface {
            vertices, strain, frame, u, rest, row_nodes, row_weights, triangles, fans,
            triangle_of, positions, normals, scalars
        }
        EfgLaw { forces, changes }
        EfgStep {
            dt, inertia, gravity, tolerance, furthest, wall, from, to, reach, max_iterations, elasticity,
            is_paper, only_forces, substep, step
        }
        Efg {
            bricks, starts, row_count, is_followed, cell, step, laws, neighbours, flags, cells, shown, mass,
            heavy, inverse, rotations, frames, u, v, x, b, r, z, p, w, s, ax, touched, shares, press,
            meetings, arrived, partials, seen, is_settled, near_tools, started, row_cells,
            row_entries, row_bricks, row_starts, row_places, row_rotations, row_frames, row_given, report
        }
        Facing { nodes, weights, inverse_kg, normal }
        Sides { all, cells, classes }
        Stuck { nodes, weights, inverse_kg, limit, at, along, tool }
        Pull { by, u, v, arm, along, goes, gives, impulse }
        EdgePoint { along, velocity, stiffness, most, impulse, next, moving, answer, sticks, next_sticks }
        EdgeCarrier { slot, start, count }
        EdgeLoad { weight, point }
        Sticks { all, pulls, count, sums, points, carriers, carrier_count, loads, carrier_at, substeps, begins }
        Birth { slot, from }
        Reworded { slot, word }
        Turned { row, from, is_row }
        Cut { births, words, turns, born, reworded, turned, u, vectors, rotations, row_rotations }
        Places { brick, axis, node }
        Look { places, u, nodes, seen, bounds }
        Shown { bricks, seen, nodes }
    };
    let numbers = [
        ("sizeof(Mark)", MARK_BYTES),
        ("FIX_X", flag::FIX_X.into()),
        ("FIX_Y", usize::from(flag::FIX_X << 1)),
        ("FIX_Z", usize::from(flag::FIX_X << 2)),
        ("GRASPED", flag::GRASPED.into()),
        ("BRICK_NODES", BRICK_SLOTS),
        ("NO_PLACE", NO_PLACE as usize),
        ("MAX_TOOLS", MAX_TOOLS),
        ("MAX_POINTS", MAX_POINTS),
        ("MAX_SITES", MAX_SITES),
        ("MAX_ROW", MAX_ROW),
        ("MAX_COUPLED", MAX_COUPLED),
        ("CONTACT_SHARED_BYTES", CONTACT_SHARED_BYTES as usize),
        ("COUNTS", COUNTS),
        ("TOLD_FIELDS", point::TOLD),
        ("AWAKE", sleepers::AWAKE),
        ("WATCHED", sleepers::WATCHED),
        ("AWAKE_NODES", sleepers::AWAKE_NODES),
        ("SLEEP_COUNTS", sleepers::COUNTS),
        ("NORMAL", point::NORMAL),
        ("AT", point::AT),
        ("NAMES", point::NAMES),
        ("IMPULSE", point::IMPULSE),
        ("POINT_FIELDS", point::FIELDS),
        ("VECTOR", numbers::VECTOR),
        ("BLOCK", numbers::BLOCK),
        ("ROTATION", numbers::ROTATION),
        ("FRAME", numbers::FRAME),
        ("PRESS_FIELDS", PRESS_FIELDS),
        ("GRID_NUMBERS", GRID_NUMBERS),
        ("ROW", ROW),
        ("sizeof(RowCell<float>)", size_of::<rows::Cell<f32>>()),
        ("sizeof(RowCell<double>)", size_of::<rows::Cell<f64>>()),
        ("offsetof(RowCell<double>, material)", offset_of!(rows::Cell<f64>, material)),
        ("sizeof(RowEntry<float>)", size_of::<rows::Entry<f32>>()),
        ("sizeof(RowEntry<double>)", size_of::<rows::Entry<f64>>()),
        ("offsetof(RowEntry<double>, share)", offset_of!(rows::Entry<f64>, share)),
        ("offsetof(RowEntry<double>, arm)", offset_of!(rows::Entry<f64>, arm)),
        ("offsetof(RowEntry<double>, slot)", offset_of!(rows::Entry<f64>, slot)),
        ("sizeof(RowPlace)", size_of::<rows::Place>()),
        ("EFG_BLOCK_BYTES<float>", efg_block_bytes(4)),
        ("EFG_TEAM_BYTES<double>", efg_team_bytes(8)),
    ];

    let header = twins::header("layout.cuh");
    let shared = header.lines().filter_map(|line| line.strip_prefix("struct ")?.strip_suffix(" {"));
    // What is written for any precision is compared by its numbers.
    let compared = ["Mark", "RowCell", "RowEntry", "RowPlace"];
    for name in shared.filter(|name| !compared.contains(name)) {
        assert!(structs.iter().any(|(known, _)| *known == name), "struct {name} is compared with nothing");
    }

    let claims = structs.into_iter().flat_map(|(_, claims)| claims);
    let claims = claims.chain(numbers.map(|(name, number)| format!("{name} == {number}")));
    // The vectors that CUDA brings.
    let mut source = String::from(
        "#include <stddef.h>\n\
         struct alignas(16) float4 { float x, y, z, w; };\n\
         struct alignas(16) uint4 { unsigned x, y, z, w; };\n\
         struct alignas(8) uint2 { unsigned x, y; };\n\
         #include \"layout.cuh\"\n",
    );
    source.extend(claims.map(|claim| format!("static_assert({claim});\n")));
    let dir = tempfile::tempdir().expect("a folder for the source");
    let file = dir.path().join("layout.cpp");
    std::fs::write(&file, source).expect("the source can be written");
    twins::compile(&file, &["-fsyntax-only".as_ref()]);
}
