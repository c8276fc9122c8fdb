/* Asks for every backend, steps on what it gets, and says what came of it, a line for each. Whatever the driver does, the
 * processor must serve, and a simulation whose GPU is lost must say so and go quietly.
 */
#include "check.h"

#include <math.h>

static int fallback_lines;

static void count_fallbacks(void *user, int32_t level, const char *line) {
    (void)user;
    fallback_lines += level == PLP_LOG_INFO && strstr(line, "the processor is taken: ") != NULL;
}

static plp_status create(const plp_model *model, uint32_t backend, plp_sim **sim) {
    plp_sim_desc desc = plp_sim_desc_default();
    desc.backend = backend;
    desc.threads = 1;
    desc.log = count_fallbacks;
    desc.flags &= ~PLP_SIM_SLEEPING; /* a driver that computes nothing counts nobody awake */
    return plp_sim_create(model, &desc, sim);
}

/* A ball large enough for contact on a GPU. */
static plp_tool *large_ball(plp_sim *sim) {
    plp_tool_part part = plp_sphere(0.03);
    plp_tool_desc desc = plp_tool_desc_default();
    plp_tool *tool = NULL;
    desc.parts = &part;
    desc.part_count = 1;
    ANSWERS(PLP_OK, plp_tool_create(sim, &desc, &tool));
    return tool;
}

/* After the loss of its device: nothing but an end. */
static void check_lost(plp_sim *sim, plp_tool *tool, plp_surface *surface, int had_frame) {
    plp_statistics statistics;
    plp_latency latency;
    plp_surface_view view;
    plp_force force;
    plp_pick pick;
    plp_place place;
    plp_tool *another = NULL;
    plp_tool_desc none = plp_tool_desc_default();
    const double origin[3] = {0.02, 0.02, 0.1}, down[3] = {0, 0, -1};
    uint64_t count = 0;
    for (int i = 0; i < 3; ++i) ANSWERS(PLP_ERR_DEVICE, plp_sim_step(sim));
    ANSWERS(PLP_ERR_DEVICE, plp_sim_reset(sim));
    ANSWERS(PLP_ERR_DEVICE, plp_sim_settle(sim, 1.0, 10, NULL));
    ANSWERS(PLP_ERR_DEVICE, plp_sim_pick(sim, origin, down, &pick));
    ANSWERS(PLP_ERR_DEVICE, plp_sim_get_nodes(sim, PLP_NODES_DISPLACEMENT, NULL, 0, &count));
    ANSWERS(PLP_ERR_DEVICE, plp_sim_get_contacts(sim, tool, NULL, 0, &count));
    ANSWERS(PLP_ERR_DEVICE, plp_sim_get_statistics(sim, &statistics, sizeof statistics));
    ANSWERS(PLP_ERR_DEVICE, plp_sim_get_latency(sim, &latency, sizeof latency));
    ANSWERS(PLP_ERR_DEVICE, plp_sim_reset_latency(sim));
    ANSWERS(PLP_ERR_DEVICE, plp_sim_get_place(sim, &place, sizeof place));
    ANSWERS(PLP_ERR_DEVICE, plp_tool_create(sim, &none, &another));
    force.force_n[0] = NAN;
    CHECK(plp_tool_get_force(tool, &force) == PLP_STOPPED);
    CHECK(force.force_n[0] == 0 && force.force_n[1] == 0 && force.force_n[2] == 0);
    ANSWERS(had_frame ? PLP_STOPPED : PLP_ERR_STATE, plp_surface_map(surface, &view, sizeof view));
    ANSWERS(had_frame ? PLP_OK : PLP_ERR_STATE, plp_surface_unmap(surface));
}

/* What the simulation says of itself after `steps` steps that ended well. */
static void check_statistics(plp_sim *sim, const char *name, uint64_t steps) {
    plp_statistics now;
    plp_latency latency;
    uint64_t counted = 0;
    ANSWERS(PLP_OK, plp_sim_get_statistics(sim, &now, sizeof now));
    CHECK(now.steps == steps && now.awake_brick_count > 0 && now.step_device_s > 0);
    ANSWERS(PLP_OK, plp_sim_get_latency(sim, &latency, sizeof latency));
    CHECK(latency.step_count == steps && latency.max_s >= now.step_wall_s);
    CHECK(latency.p50_s > 0 && latency.p50_s <= latency.p99_s && latency.p99_s <= latency.p999_s);
    CHECK(latency.p999_s <= latency.max_s);
    for (int i = 0; i < PLP_LATENCY_BUCKETS; ++i) counted += latency.counts[i];
    CHECK(counted == steps);
    ANSWERS(PLP_OK, plp_sim_reset_latency(sim));
    ANSWERS(PLP_OK, plp_sim_get_latency(sim, &latency, sizeof latency));
    CHECK(latency.step_count == 0 && latency.max_s == 0 && latency.p99_s == 0);
    printf("%s: %.6f s on the device\n", name, now.step_device_s);
    printf("%s: %llu bytes to the device, %llu to the host\n", name, (unsigned long long)now.bytes_to_device,
           (unsigned long long)now.bytes_to_host);
}

static void try_backend(const plp_model *model, const char *name, uint32_t backend) {
    plp_sim *sim = NULL;
    plp_place place;
    fallback_lines = 0;
    plp_status status = create(model, backend, &sim);
    if (status < 0) {
        CHECK(sim == NULL && backend == PLP_BACKEND_CUDA);
        printf("%s: %s: %s\n", name, plp_status_name(status), plp_last_error());
        return;
    }
    ANSWERS(PLP_OK, plp_sim_get_place(sim, &place, sizeof place));
    CHECK(fallback_lines == (place.fallback[0] != 0));
    printf("%s: %s, device %d, %s; %s\n", name, place.backend == PLP_BACKEND_CUDA ? "gpu" : "cpu", place.device,
           place.name, place.fallback);

    plp_tool *tool = large_ball(sim);
    plp_surface *surface = NULL;
    plp_surface_view view;
    plp_force force;
    ANSWERS(PLP_OK, plp_surface_create(sim, 0, &surface));
    plp_status shown = plp_surface_map(surface, &view, sizeof view);
    if (shown < 0) {
        printf("%s: surface: %s: %s\n", name, plp_status_name(shown), plp_last_error());
    } else {
        ANSWERS(PLP_OK, plp_surface_unmap(surface));
    }
    plp_status read = PLP_OK;
    for (int step = 1; step <= 40 && status >= 0; ++step) {
        plp_motion motion = plp_motion_at(0.02, 0.02, 0.07 - 5e-5 * step); /* 2 mm into the block in the end */
        CHECK(plp_tool_set_pose(tool, &motion) == PLP_OK);
        status = plp_sim_step(sim);
        if (status < 0) {
            printf("%s: step %d: %s: %s\n", name, step, plp_status_name(status), plp_last_error());
            if (status == PLP_ERR_DEVICE) check_lost(sim, tool, surface, shown == PLP_OK);
            continue;
        }
        if (step == 10) {
            plp_energy energy = {-1, -1, -1, -1};
            read = plp_sim_get_energy(sim, &energy, sizeof energy);
            CHECK((read == PLP_OK) == (energy.kinetic_j >= 0));
            if (read < 0) printf("%s: energy: %s: %s\n", name, plp_status_name(read), plp_last_error());
        }
        CHECK(plp_tool_get_force(tool, &force) == (read == PLP_OK ? PLP_OK : PLP_STOPPED));
        CHECK(place.backend == PLP_BACKEND_CUDA || step < 40 || force.force_n[2] > 0);
    }
    if (status >= 0) check_statistics(sim, name, 40);
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
    ANSWERS(PLP_OK, plp_tool_destroy(tool));
    ANSWERS(PLP_OK, plp_surface_destroy(surface));
}

int main(void) {
    plp_device_info info;
    uint32_t count = plp_device_count();
    printf("gpus: %u; %s\n", count, count ? "" : plp_last_error());
    for (uint32_t i = 0; i < count; ++i) {
        ANSWERS(PLP_OK, plp_device_get(i, &info, sizeof info));
        printf("gpu %u: %s, %u.%u, %llu bytes, supported %u\n", i, info.name, info.capability_major,
               info.capability_minor, (unsigned long long)info.memory_bytes, info.is_supported);
    }
    ANSWERS(count ? PLP_ERR_ARGUMENT : PLP_ERR_NO_DEVICE, plp_device_get(count, &info, sizeof info));

    plp_model *model = block();
    try_backend(model, "cuda", PLP_BACKEND_CUDA);
    try_backend(model, "auto", PLP_BACKEND_AUTO);
    try_backend(model, "cpu", PLP_BACKEND_CPU);
    ANSWERS(PLP_OK, plp_model_destroy(model));
    puts("backends: ok");
    return 0;
}
