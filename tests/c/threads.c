/* A servo thread and a render thread work while the simulation steps; two threads on one handle are told so. */
#include "check.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>

static plp_sim *sim;
static plp_tool *tool;
static plp_surface *surface;
static atomic_int done, busy;

static void *servo(void *unused) {
    (void)unused;
    uint64_t last = 0;
    while (!atomic_load(&done)) {
        /* In and out by a little in each step, however many turns this thread gets in one. */
        const double depth = 2e-5 * abs((int)(last % 1000) - 500);
        plp_motion motion = plp_motion_at(0.02, 0.02, 0.042 + depth);
        plp_force force;
        CHECK(plp_tool_set_pose(tool, &motion) == PLP_OK);
        CHECK(plp_tool_get_force(tool, &force) == PLP_OK);
        CHECK(force.sequence >= last); /* never an older force */
        last = force.sequence;
    }
    return NULL;
}

static void *renderer(void *unused) {
    (void)unused;
    double last = -1.0;
    while (!atomic_load(&done)) {
        plp_surface_view view;
        ANSWERS(PLP_OK, plp_surface_map(surface, &view, sizeof view));
        CHECK(view.time_s >= last);
        last = view.time_s;
        for (uint64_t i = 0; i < view.vertex_count; ++i) {
            CHECK(isfinite(view.positions[4 * i]) && view.positions[4 * i + 3] == 1.0f);
        }
        for (uint64_t i = 0; i < 3 * view.triangle_count; ++i) {
            CHECK(view.triangles[i] < view.vertex_count);
        }
        ANSWERS(PLP_OK, plp_surface_unmap(surface));
    }
    return NULL;
}

/* A thread that must not be here: it is refused or takes its turn, and nothing breaks. */
static void *intruder(void *unused) {
    (void)unused;
    while (!atomic_load(&done)) {
        plp_statistics statistics;
        plp_status status = plp_sim_get_statistics(sim, &statistics, sizeof statistics);
        CHECK(status == PLP_OK || status == PLP_ERR_BUSY);
        if (status == PLP_ERR_BUSY) {
            atomic_fetch_add(&busy, 1);
        }
    }
    return NULL;
}

int main(void) {
    plp_model *model = block();
    pthread_t threads[3];
    void *(*const work[3])(void *) = {servo, renderer, intruder};
    sim = simulation(model);
    tool = ball(sim);
    ANSWERS(PLP_OK, plp_surface_create(sim, 0, &surface));
    for (int i = 0; i < 3; ++i) {
        CHECK(pthread_create(&threads[i], NULL, work[i], NULL) == 0);
    }
    for (int steps = 0; steps < 500 || (!atomic_load(&busy) && steps < 100000);) {
        plp_contact contacts[64];
        uint64_t count = 0;
        plp_status status = plp_sim_step(sim);
        CHECK(status == PLP_OK || status == PLP_ERR_BUSY);
        steps += status == PLP_OK;
        /* Contacts are read while the servo thread is inside its tool. */
        status = plp_sim_get_contacts(sim, tool, contacts, 64, &count);
        CHECK(status == PLP_OK || status == PLP_TRUNCATED || status == PLP_ERR_BUSY);
    }
    atomic_store(&done, 1);
    for (int i = 0; i < 3; ++i) {
        CHECK(pthread_join(threads[i], NULL) == 0);
    }
    CHECK(atomic_load(&busy) > 0);
    ANSWERS(PLP_OK, plp_tool_destroy(tool));
    ANSWERS(PLP_OK, plp_surface_destroy(surface));
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
    ANSWERS(PLP_OK, plp_model_destroy(model));
    puts("threads: ok");
    return 0;
}
