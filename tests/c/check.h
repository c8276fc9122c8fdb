/* What the C tests share: a check that names its line, and a small model. */
#ifndef CHECK_H
#define CHECK_H

#include <palpate/palpate.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHECK(condition)                                                                              \
    do {                                                                                              \
        if (!(condition)) {                                                                           \
            fprintf(stderr, "%s:%d: %s\n  last error: %s\n", __FILE__, __LINE__, #condition,          \
                    plp_last_error());                                                                \
            exit(1);                                                                                  \
        }                                                                                             \
    } while (0)

/* A call must answer this status, and an error must come with a sentence. */
#define ANSWERS(expected, call)                                                                       \
    do {                                                                                              \
        plp_status answer = (call);                                                                   \
        if (answer != (expected) || (answer < 0 && plp_last_error()[0] == 0)) {                       \
            fprintf(stderr, "%s:%d: %s\n  answered %s, not %s\n  last error: %s\n", __FILE__,         \
                    __LINE__, #call, plp_status_name(answer), plp_status_name(expected),              \
                    plp_last_error());                                                                \
            exit(1);                                                                                  \
        }                                                                                             \
    } while (0)

/* A block of 8 x 8 x 8 voxels of 5 mm, its lower corner at the origin, held at the bottom (low z). */
static const uint8_t *block_labels(void) {
    static uint8_t labels[8 * 8 * 8];
    memset(labels, 1, sizeof labels);
    return labels;
}

static inline plp_label_grid block_grid(void) {
    plp_label_grid grid = {block_labels(), 1, {8, 8, 8}, {0.005, 0.005, 0.005}, {{0}, {0}}, NULL};
    grid.frame = plp_pose_at(0.0025, 0.0025, 0.0025);
    return grid;
}

static inline plp_label_use block_use(void) {
    plp_label_use use = {1, PLP_USE_TISSUE, {5e3, 0.4, 1000.0, 0.001, "jelly"}};
    return use;
}

static inline plp_model *block(void) {
    plp_label_grid grid = block_grid();
    plp_label_use use = block_use();
    plp_model_desc desc = plp_model_desc_default();
    plp_model *model = NULL;
    desc.grid = &grid;
    desc.uses = &use;
    desc.use_count = 1;
    desc.fix_faces = PLP_FACE_Z_LOW;
    ANSWERS(PLP_OK, plp_model_create(&desc, &model));
    return model;
}

static inline plp_sim *simulation(const plp_model *model) {
    plp_sim_desc desc = plp_sim_desc_default();
    plp_sim *sim = NULL;
    desc.threads = 1;
    ANSWERS(PLP_OK, plp_sim_create(model, &desc, &sim));
    return sim;
}

static inline plp_tool *ball_of(plp_sim *sim, const plp_haptic_desc *haptic) {
    plp_tool_part part = plp_sphere(0.008);
    plp_tool_desc desc = plp_tool_desc_default();
    plp_tool *tool = NULL;
    desc.parts = &part;
    desc.part_count = 1;
    desc.haptic = haptic;
    ANSWERS(PLP_OK, plp_tool_create(sim, &desc, &tool));
    return tool;
}

static inline plp_tool *ball(plp_sim *sim) { return ball_of(sim, NULL); }

/* A ball that a haptic device holds. */
static inline plp_tool *held_ball(plp_sim *sim) {
    plp_haptic_desc haptic = plp_haptic_desc_default();
    return ball_of(sim, &haptic);
}

#endif
