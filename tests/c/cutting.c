/* Cuts a block, by hand and with a blade: what a host sees of it, and what it is told when a cut cannot be. */
#include "check.h"

#include <math.h>

static plp_sim *cuttable(const plp_model *model, uint64_t cut_nodes) {
    plp_sim_desc desc = plp_sim_desc_default();
    plp_sim *sim = NULL;
    desc.threads = 1;
    desc.cut_nodes = cut_nodes;
    ANSWERS(PLP_OK, plp_sim_create(model, &desc, &sim));
    return sim;
}

/* A straight edge along y, longer than the block is wide. */
static plp_status add_blade(plp_sim *sim, double toughness_j_m2, plp_tool **tool) {
    static const double edge[6] = {0, -0.1, 0, 0, 0.1, 0};
    plp_blade blade = {edge, 2, 0, toughness_j_m2};
    plp_tool_desc desc = plp_tool_desc_default();
    desc.blade = &blade;
    return plp_tool_create(sim, &desc, tool);
}

/* A level cut from x = from to x = to at a height, all in metres. */
static plp_status slit(plp_sim *sim, double from, double to, double height, uint64_t *cells) {
    const double start[6] = {from, -0.1, height, from, 0.2, height};
    const double end[6] = {to, -0.1, height, to, 0.2, height};
    return plp_sim_cut(sim, start, end, 2, cells);
}

static void check_by_hand(const plp_model *model) {
    plp_sim *sim = cuttable(model, 4000);
    plp_surface *surface = NULL;
    plp_surface_view view;
    plp_part parts[4];
    uint64_t count = 0, cells = 0, before;
    ANSWERS(PLP_OK, plp_surface_create(sim, 0, &surface));
    ANSWERS(PLP_OK, plp_surface_map(surface, &view, sizeof view));
    CHECK(view.topology_version == 0 && view.first_wall_triangle == view.triangle_count);
    before = view.vertex_count;
    ANSWERS(PLP_OK, plp_surface_unmap(surface));

    ANSWERS(PLP_OK, slit(sim, 0.05, -0.01, 0.0215, &cells));
    CHECK(cells == 64);
    ANSWERS(PLP_OK, plp_sim_get_parts(sim, parts, 4, &count));
    CHECK(count == 2 && parts[0].is_held == 1 && parts[1].is_held == 0);
    CHECK(fabs(parts[0].volume_m3 + parts[1].volume_m3 - 6.4e-5) < 1e-12);
    CHECK(fabs(parts[0].volume_m3 - 0.04 * 0.04 * 0.0215) < 1e-10);
    ANSWERS(PLP_TRUNCATED, plp_sim_get_parts(sim, parts, 1, &count));
    ANSWERS(PLP_OK, plp_surface_map(surface, &view, sizeof view));
    CHECK(view.topology_version > 0 && view.vertex_count > before);
    CHECK(view.first_wall_triangle < view.triangle_count);
    for (uint64_t i = 3 * view.first_wall_triangle; i < 3 * view.triangle_count; ++i) {
        uint32_t vertex = view.triangles[i];
        CHECK(vertex < view.vertex_count && fabsf(view.positions[4 * vertex + 2] - 0.0215f) < 1e-5f);
    }
    ANSWERS(PLP_OK, plp_surface_unmap(surface));
    /* What is cut is cut. */
    ANSWERS(PLP_OK, slit(sim, 0.05, -0.01, 0.0215, &cells));
    CHECK(cells == 0);
    for (int i = 0; i < 5; ++i) ANSWERS(PLP_OK, plp_sim_step(sim));
    ANSWERS(PLP_OK, plp_sim_reset(sim));
    ANSWERS(PLP_OK, plp_sim_get_parts(sim, parts, 4, &count));
    CHECK(count == 1);
    ANSWERS(PLP_OK, plp_surface_destroy(surface));
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
}

static void check_blade(const plp_model *model) {
    plp_sim *sim = cuttable(model, 4000);
    plp_tool *tool = NULL;
    plp_force force;
    plp_statistics statistics;
    double most = 0;
    ANSWERS(PLP_OK, add_blade(sim, 20.0, &tool));
    for (int step = 0; step < 300; ++step) {
        plp_motion motion = plp_motion_at(0.045 - 2e-4 * step, 0.0, 0.0215);
        ANSWERS(PLP_OK, plp_tool_set_pose(tool, &motion));
        ANSWERS(PLP_OK, plp_sim_step(sim));
        ANSWERS(PLP_OK, plp_tool_get_force(tool, &force));
        if (force.force_n[0] > most) most = force.force_n[0];
    }
    /* 20 J/m^2 times 40 mm, and up to two points of the edge more, where the tissue bulges. */
    CHECK(most > 0.4 && most < 0.801 + 2 * 20.0 * 0.0025);
    ANSWERS(PLP_OK, plp_sim_get_statistics(sim, &statistics, sizeof statistics));
    CHECK(statistics.divided_cell_count == 64 && statistics.copy_count > 0);
    ANSWERS(PLP_OK, plp_tool_destroy(tool));
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
}

/* A ball of 14 mm inside of the block, a part that is cut off, and all of it back. */
static void check_removal(const plp_model *model) {
    plp_sim *sim = cuttable(model, 4000);
    plp_tool_part ball = {PLP_SHAPE_SPHERE, 0, {{0}, {0}}, 0.014, 0, {0}};
    plp_removed removed;
    plp_statistics statistics;
    plp_part parts[4];
    uint64_t count = 0;
    ball.pose = plp_pose_at(0.021, 0.0195, 0.0205);
    ANSWERS(PLP_OK, plp_sim_ablate(sim, &ball, &removed));
    CHECK(fabs(removed.volume_m3 / 1.14940e-5 - 1.0) < 0.1);
    CHECK(fabs(removed.mass_kg - 1000.0 * removed.volume_m3) < 1e-12);
    ANSWERS(PLP_OK, plp_sim_get_parts(sim, parts, 4, &count));
    CHECK(count == 1 && fabs(parts[0].volume_m3 + removed.volume_m3 - 6.4e-5) < 1e-12);
    ANSWERS(PLP_OK, plp_sim_ablate(sim, &ball, &removed));
    CHECK(removed.volume_m3 == 0.0 && removed.mass_kg == 0.0);

    ANSWERS(PLP_OK, slit(sim, 0.05, -0.01, 0.0363, NULL));
    ANSWERS(PLP_OK, plp_sim_get_parts(sim, parts, 4, &count));
    CHECK(count == 2 && parts[1].is_held == 0);
    ANSWERS(PLP_OK, plp_sim_remove_part(sim, parts[1].id, &removed));
    CHECK(removed.volume_m3 == parts[1].volume_m3);
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_remove_part(sim, parts[1].id, NULL));
    ANSWERS(PLP_OK, plp_sim_step(sim));
    ANSWERS(PLP_OK, plp_sim_get_statistics(sim, &statistics, sizeof statistics));
    CHECK(fabs(parts[0].mass_kg + statistics.removed_kg - 6.4e-2) < 1e-9);
    CHECK(fabs(parts[0].volume_m3 + statistics.removed_m3 - 6.4e-5) < 1e-12);

    ANSWERS(PLP_ERR_NULL, plp_sim_ablate(sim, NULL, &removed));
    ball.radius_m = NAN;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_ablate(sim, &ball, &removed));
    ANSWERS(PLP_OK, plp_sim_reset(sim));
    ANSWERS(PLP_OK, plp_sim_get_parts(sim, parts, 4, &count));
    CHECK(count == 1 && fabs(parts[0].volume_m3 - 6.4e-5) < 1e-12);
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
}

static void check_refusals(const plp_model *model) {
    plp_sim *whole = cuttable(model, 0), *small = cuttable(model, 16);
    plp_tool *tool = NULL;
    plp_event event;
    const double far[6] = {0, 0, 0, 1e9, 0, 0}, nan[6] = {0, 0, 0, NAN, 0, 0};
    plp_tool_part ball = {PLP_SHAPE_SPHERE, 0, {{0}, {0}}, 0.015, 0, {0}};
    ANSWERS(PLP_ERR_STATE, slit(whole, 0.05, -0.01, 0.0215, NULL));
    ANSWERS(PLP_ERR_STATE, add_blade(whole, 0.0, &tool));
    ball.pose = plp_pose_at(0.02, 0.02, 0.02);
    ANSWERS(PLP_ERR_STATE, plp_sim_ablate(whole, &ball, NULL));
    ANSWERS(PLP_ERR_LIMIT, plp_sim_ablate(small, &ball, NULL));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_cut(small, far, far, 2, NULL));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_cut(small, nan, nan, 2, NULL));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_cut(small, nan, nan, 1000000, NULL));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_cut(small, far, far, 1, NULL));
    ANSWERS(PLP_ERR_NULL, plp_sim_cut(small, NULL, far, 2, NULL));
    ANSWERS(PLP_ERR_ARGUMENT, add_blade(small, -1.0, &tool));
    ANSWERS(PLP_ERR_ARGUMENT, add_blade(small, NAN, &tool));

    /* All at once needs more than there is room for: nothing is cut, and the simulation goes on. */
    ANSWERS(PLP_ERR_LIMIT, slit(small, 0.05, -0.01, 0.0215, NULL));
    ANSWERS(PLP_OK, add_blade(small, 0.0, &tool));
    for (int step = 0; step < 2; ++step) {
        plp_motion motion = plp_motion_at(0.05 - 0.06 * step, 0.0, 0.0215);
        ANSWERS(PLP_OK, plp_tool_set_pose(tool, &motion));
        ANSWERS(PLP_OK, plp_sim_step(small));
    }
    ANSWERS(PLP_OK, plp_sim_poll_event(small, &event, sizeof event));
    CHECK(event.kind == PLP_EVENT_CUT_REFUSED && event.tool_id == plp_tool_get_id(tool));
    ANSWERS(PLP_NOTHING, plp_sim_poll_event(small, &event, sizeof event));
    ANSWERS(PLP_OK, plp_tool_destroy(tool));
    ANSWERS(PLP_OK, plp_sim_destroy(small));
    ANSWERS(PLP_OK, plp_sim_destroy(whole));
}

int main(void) {
    plp_model *model = block();
    check_by_hand(model);
    check_blade(model);
    check_removal(model);
    check_refusals(model);
    ANSWERS(PLP_OK, plp_model_destroy(model));
    printf("cutting: ok\n");
    return 0;
}
