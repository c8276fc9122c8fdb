/* Takes a snapshot of a block that a ball presses, cuts it, and goes back. */
#include "check.h"

typedef struct {
    plp_sim *sim;
    plp_tool *ball;
} world;

static world create(const plp_model *model, uint64_t cut_nodes) {
    plp_sim_desc desc = plp_sim_desc_default();
    plp_tool_desc tool = plp_tool_desc_default();
    plp_tool_part part = plp_sphere(0.010);
    world w = {NULL, NULL};
    desc.threads = 1;
    desc.cut_nodes = cut_nodes;
    tool.parts = &part;
    tool.part_count = 1;
    ANSWERS(PLP_OK, plp_sim_create(model, &desc, &w.sim));
    ANSWERS(PLP_OK, plp_tool_create(w.sim, &tool, &w.ball));
    return w;
}

static void destroy(world w) {
    ANSWERS(PLP_OK, plp_tool_destroy(w.ball));
    ANSWERS(PLP_OK, plp_sim_destroy(w.sim));
}

/* Presses on from step from to step to; gives the last force. */
static plp_force press(world w, int from, int to) {
    plp_force force;
    for (int step = from; step < to; ++step) {
        plp_motion motion = plp_motion_at(0.02, 0.02, 0.051 - 1e-4 * step);
        ANSWERS(PLP_OK, plp_tool_set_pose(w.ball, &motion));
        ANSWERS(PLP_OK, plp_sim_step(w.sim));
    }
    ANSWERS(PLP_OK, plp_tool_get_force(w.ball, &force));
    return force;
}

static void cut(world w) {
    const double start[6] = {0.05, -0.1, 0.0215, 0.05, 0.2, 0.0215};
    const double end[6] = {-0.01, -0.1, 0.0215, -0.01, 0.2, 0.0215};
    uint64_t cells = 0;
    ANSWERS(PLP_OK, plp_sim_cut(w.sim, start, end, 2, &cells));
    CHECK(cells == 64);
}

static uint64_t parts(world w) {
    uint64_t count = 0;
    ANSWERS(PLP_TRUNCATED, plp_sim_get_parts(w.sim, NULL, 0, &count));
    return count;
}

static int same(plp_force a, plp_force b) {
    return memcmp(a.force_n, b.force_n, sizeof a.force_n) == 0 &&
           memcmp(a.torque_n_m, b.torque_n_m, sizeof a.torque_n_m) == 0;
}

static void check_replay(const plp_model *model) {
    world w = create(model, 4000), other = create(model, 4000);
    plp_snapshot *whole = NULL, *divided = NULL;
    plp_force at_last, in_two;
    press(w, 0, 30);
    ANSWERS(PLP_OK, plp_sim_snapshot(w.sim, &whole));
    at_last = press(w, 30, 40);
    CHECK(at_last.force_n[2] > 0);
    cut(w);
    CHECK(parts(w) == 2);
    ANSWERS(PLP_OK, plp_sim_snapshot(w.sim, &divided));
    in_two = press(w, 40, 50);

    ANSWERS(PLP_OK, plp_sim_restore(w.sim, whole));
    CHECK(parts(w) == 1 && same(press(w, 30, 40), at_last));
    ANSWERS(PLP_OK, plp_sim_restore(w.sim, divided));
    CHECK(parts(w) == 2 && same(press(w, 40, 50), in_two));
    /* A snapshot outlives its simulation, and serves another one. */
    destroy(w);
    ANSWERS(PLP_OK, plp_sim_restore(other.sim, divided));
    CHECK(parts(other) == 2 && same(press(other, 40, 50), in_two));
    ANSWERS(PLP_OK, plp_snapshot_destroy(divided));
    ANSWERS(PLP_OK, plp_sim_restore(other.sim, whole));
    CHECK(parts(other) == 1 && same(press(other, 30, 40), at_last));
    ANSWERS(PLP_OK, plp_snapshot_destroy(whole));
    destroy(other);
}

static void check_refusals(const plp_model *model) {
    world w = create(model, 4000), whole = create(model, 0);
    plp_snapshot *snapshot = NULL, *gone;
    press(w, 0, 2);
    ANSWERS(PLP_ERR_NULL, plp_sim_snapshot(w.sim, NULL));
    ANSWERS(PLP_ERR_NULL, plp_sim_snapshot(NULL, &snapshot));
    CHECK(snapshot == NULL);
    ANSWERS(PLP_OK, plp_sim_snapshot(w.sim, &snapshot));
    ANSWERS(PLP_ERR_NULL, plp_sim_restore(w.sim, NULL));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_sim_restore(w.sim, (const plp_snapshot *)(const void *)w.sim));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_sim_restore((plp_sim *)(void *)snapshot, snapshot));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_restore(whole.sim, snapshot));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_snapshot_destroy((plp_snapshot *)(void *)w.sim));
    ANSWERS(PLP_OK, plp_sim_restore(w.sim, snapshot));
    gone = snapshot;
    ANSWERS(PLP_OK, plp_snapshot_destroy(snapshot));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_sim_restore(w.sim, gone));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_snapshot_destroy(gone));
    ANSWERS(PLP_OK, plp_snapshot_destroy(NULL));
    press(w, 2, 4);
    destroy(w);
    destroy(whole);
}

int main(void) {
    plp_model *model = block();
    check_replay(model);
    check_refusals(model);
    ANSWERS(PLP_OK, plp_model_destroy(model));
    printf("snapshot: ok\n");
    return 0;
}
