/* A model, a simulation, a tool and a surface, destroyed in all 24 orders; what is left is used in between. */
#include "check.h"

#include <math.h>

enum { MODEL, SIM, TOOL, SURFACE, KINDS };

typedef struct {
    plp_model *model;
    plp_sim *sim;
    plp_tool *tool;
    plp_surface *surface;
    int alive[KINDS];
} world;

static void use(world *w) {
    plp_motion motion = plp_motion_at(0.02, 0.02, 0.046);
    plp_force force;
    plp_surface_view view;
    plp_model_info info;

    if (w->alive[MODEL]) {
        ANSWERS(PLP_OK, plp_model_get_info(w->model, &info, sizeof info));
        CHECK(info.cell_count == 512);
    }
    if (w->alive[TOOL]) {
        CHECK(plp_tool_set_pose(w->tool, &motion) == (w->alive[SIM] ? PLP_OK : PLP_STOPPED));
    }
    if (w->alive[SIM]) {
        ANSWERS(PLP_OK, plp_sim_step(w->sim));
    }
    if (w->alive[TOOL]) {
        CHECK(plp_tool_get_force(w->tool, &force) == (w->alive[SIM] ? PLP_OK : PLP_STOPPED));
        if (!w->alive[SIM]) { /* a device must be let go */
            CHECK(force.force_n[0] == 0 && force.force_n[1] == 0 && force.force_n[2] == 0);
        }
    }
    if (w->alive[SURFACE]) {
        ANSWERS(w->alive[SIM] ? PLP_OK : PLP_STOPPED, plp_surface_map(w->surface, &view, sizeof view));
        for (uint64_t i = 0; i < 4 * view.vertex_count; ++i) {
            CHECK(isfinite(view.positions[i]) && isfinite(view.normals[i]));
        }
        ANSWERS(PLP_OK, plp_surface_unmap(w->surface));
    }
}

static void destroy(world *w, int kind) {
    switch (kind) {
    case MODEL: ANSWERS(PLP_OK, plp_model_destroy(w->model)); break;
    case SIM: ANSWERS(PLP_OK, plp_sim_destroy(w->sim)); break;
    case TOOL: ANSWERS(PLP_OK, plp_tool_destroy(w->tool)); break;
    default: ANSWERS(PLP_OK, plp_surface_destroy(w->surface)); break;
    }
    w->alive[kind] = 0;
}

int main(void) {
    int orders = 0;
    for (int code = 0; code < KINDS * KINDS * KINDS * KINDS; ++code) {
        int order[KINDS], seen = 0;
        for (int i = 0, rest = code; i < KINDS; ++i, rest /= KINDS) {
            order[i] = rest % KINDS;
            seen |= 1 << order[i];
        }
        if (seen != (1 << KINDS) - 1) {
            continue; /* not a permutation */
        }
        world w = {block(), NULL, NULL, NULL, {1, 1, 1, 1}};
        w.sim = simulation(w.model);
        w.tool = ball(w.sim);
        ANSWERS(PLP_OK, plp_surface_create(w.sim, 0, &w.surface));
        use(&w);
        for (int i = 0; i < KINDS; ++i) {
            destroy(&w, order[i]);
            use(&w);
        }
        ++orders;
    }
    CHECK(orders == 24);

    /* Destroying a mapped surface ends its view; NULL is fine everywhere. */
    plp_model *model = block();
    plp_sim *sim = simulation(model);
    plp_surface *surface = NULL;
    plp_surface_view view;
    ANSWERS(PLP_OK, plp_surface_create(sim, 0, &surface));
    ANSWERS(PLP_OK, plp_surface_map(surface, &view, sizeof view));
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
    CHECK(isfinite(view.positions[0])); /* still the host's to read */
    ANSWERS(PLP_OK, plp_surface_destroy(surface));
    ANSWERS(PLP_OK, plp_model_destroy(model));
    ANSWERS(PLP_OK, plp_model_destroy(NULL));
    ANSWERS(PLP_OK, plp_sim_destroy(NULL));
    ANSWERS(PLP_OK, plp_tool_destroy(NULL));
    ANSWERS(PLP_OK, plp_surface_destroy(NULL));
    puts("destroy order: ok");
    return 0;
}
