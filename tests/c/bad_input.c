/* Everything that a host can get wrong: a status, a sentence, no crash, and outputs as they were. */
#include "check.h"

#include <math.h>

static char *const UNTOUCHED = (char *)"untouched";

/* A desc that builds the block, for a test to spoil. */
static plp_label_grid grid;
static plp_label_use use;
static plp_model_desc good_model(void) {
    plp_model_desc desc = plp_model_desc_default();
    grid = block_grid();
    use = block_use();
    desc.grid = &grid;
    desc.uses = &use;
    desc.use_count = 1;
    return desc;
}

#define MODEL_ANSWERS(status)                                                                         \
    do {                                                                                              \
        plp_model *out = (plp_model *)UNTOUCHED;                                                      \
        ANSWERS(status, plp_model_create(&desc, &out));                                               \
        CHECK(out == (plp_model *)UNTOUCHED);                                                         \
    } while (0)

static void struct_sizes(void) {
    plp_model_desc desc = good_model();
    struct {
        plp_sim_desc known;
        uint64_t unknown[2];
    } newer;
    plp_sim *sim = (plp_sim *)UNTOUCHED;
    plp_model *model = block();

    desc.struct_size = 0;
    MODEL_ANSWERS(PLP_ERR_STRUCT_SIZE);
    desc.struct_size = 0xCDCDCDCD;
    MODEL_ANSWERS(PLP_ERR_STRUCT_SIZE);
    ANSWERS(PLP_ERR_STRUCT_SIZE, plp_model_desc_init(&desc, 3));
    ANSWERS(PLP_ERR_NULL, plp_model_desc_init(NULL, sizeof desc));

    /* A newer header's struct works as long as it asks for nothing new. */
    ANSWERS(PLP_OK, plp_sim_desc_init(&newer.known, sizeof newer));
    CHECK(newer.known.struct_size == sizeof newer && newer.unknown[0] == 0 && newer.unknown[1] == 0);
    newer.unknown[1] = 1;
    ANSWERS(PLP_ERR_UNSUPPORTED, plp_sim_create(model, &newer.known, &sim));
    CHECK(sim == (plp_sim *)UNTOUCHED);
    newer.unknown[1] = 0;
    ANSWERS(PLP_OK, plp_sim_create(model, &newer.known, &sim));
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
    ANSWERS(PLP_OK, plp_model_destroy(model));
}

static void handles(void) {
    plp_model *model = block();
    plp_sim *sim = simulation(model), *other = simulation(model);
    plp_tool *tool = ball(sim);
    plp_model_info info;
    plp_motion motion = plp_motion_at(0, 0, 1);
    plp_force force;
    plp_contact contact;
    uint64_t count = 77;
    uint64_t nothing[16] = {0};

    ANSWERS(PLP_ERR_NULL, plp_model_get_info(NULL, &info, sizeof info));
    ANSWERS(PLP_ERR_NULL, plp_sim_step(NULL));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_sim_step((plp_sim *)model));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_sim_step((plp_sim *)nothing));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_sim_step((plp_sim *)((char *)sim + 1)));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_sim_destroy((plp_sim *)tool));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_sim_get_contacts(other, tool, &contact, 1, &count));
    CHECK(count == 77);

    /* Real-time calls answer statuses and leave the last error alone. */
    char before[1024];
    strcpy(before, plp_last_error());
    CHECK(plp_tool_set_pose(NULL, &motion) == PLP_ERR_NULL);
    CHECK(plp_tool_set_pose((plp_tool *)sim, &motion) == PLP_ERR_INVALID_HANDLE);
    CHECK(plp_tool_set_pose(tool, NULL) == PLP_ERR_NULL);
    CHECK(plp_tool_get_force(tool, NULL) == PLP_ERR_NULL);
    CHECK(strcmp(before, plp_last_error()) == 0);

    ANSWERS(PLP_OK, plp_tool_destroy(tool));
    CHECK(plp_tool_get_force(tool, &force) == PLP_ERR_INVALID_HANDLE);
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_tool_destroy(tool));
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_sim_step(sim));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_sim_destroy(sim));
    ANSWERS(PLP_OK, plp_sim_destroy(other));
    ANSWERS(PLP_OK, plp_model_destroy(model));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_model_destroy(model));
}

static void grids(void) {
    plp_model_desc desc = good_model();
    ANSWERS(PLP_ERR_NULL, plp_model_create(&desc, NULL));
    grid.labels = NULL;
    MODEL_ANSWERS(PLP_ERR_NULL);

    desc = good_model();
    grid.voxels[1] = 0;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    /* More voxels than any memory: refused before a byte is read. */
    grid.voxels[0] = grid.voxels[1] = grid.voxels[2] = UINT32_MAX;
    MODEL_ANSWERS(PLP_ERR_LIMIT);

    desc = good_model();
    grid.label_bytes = 4;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);

    const double spacings[] = {0.0, -0.005, 1e9, 1e-30, NAN, INFINITY};
    for (size_t i = 0; i < sizeof spacings / sizeof *spacings; ++i) {
        desc = good_model();
        grid.spacing_m[2] = spacings[i];
        MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    }
    desc = good_model();
    memset(&grid.frame, 0, sizeof grid.frame); /* a quaternion of no length */
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    desc = good_model();
    grid.frame.position_m[0] = 1e300; /* finite, and nowhere */
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);

    const double cells[] = {-1.0, NAN, 1e-9};
    for (size_t i = 0; i < sizeof cells / sizeof *cells; ++i) {
        desc = good_model();
        desc.cell_m = cells[i];
        plp_model *out = (plp_model *)UNTOUCHED;
        CHECK(plp_model_create(&desc, &out) < 0 && out == (plp_model *)UNTOUCHED);
    }
    /* All of it empty. */
    desc = good_model();
    use.kind = PLP_USE_EMPTY;
    plp_model *out = (plp_model *)UNTOUCHED;
    CHECK(plp_model_create(&desc, &out) < 0 && out == (plp_model *)UNTOUCHED);
}

static void labels_and_materials(void) {
    plp_model_desc desc = good_model();
    desc.use_count = 0; /* label 1 occurs and nobody said what it is */
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    CHECK(strstr(plp_last_error(), "1") != NULL);

    desc = good_model();
    use.material.poisson = 0.5;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    desc = good_model();
    use.material.young_pa = NAN;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    desc = good_model();
    memset(use.material.name, 'x', sizeof use.material.name); /* no end */
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    desc = good_model();
    use = plp_label_as(1, PLP_USE_TISSUE, "livr"); /* mistyped: the message shows it */
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    CHECK(strstr(plp_last_error(), "livr") != NULL);
    desc = good_model();
    use.kind = 3;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    desc = good_model();
    use.label = 65536;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    desc = good_model();
    desc.uses = NULL;
    MODEL_ANSWERS(PLP_ERR_NULL);

    /* Sixteen different materials that all occur: one too many. */
    static uint16_t labels[16 * 4 * 4];
    plp_label_use uses[16];
    for (int i = 0; i < 16 * 4 * 4; ++i) {
        labels[i] = (uint16_t)(i % 16);
    }
    for (uint32_t i = 0; i < 16; ++i) {
        uses[i] = block_use();
        uses[i].label = i;
        uses[i].material.young_pa = 1000.0 * (i + 1);
    }
    desc = good_model();
    grid.labels = labels;
    grid.label_bytes = 2;
    grid.voxels[0] = 16;
    grid.voxels[1] = grid.voxels[2] = 4;
    desc.uses = uses;
    desc.use_count = 16;
    MODEL_ANSWERS(PLP_ERR_LIMIT);
    desc.use_count = 0xFFFFFFFF; /* of nothing */
    desc.uses = NULL;
    MODEL_ANSWERS(PLP_ERR_NULL);

    plp_preset preset;
    preset.source[0] = '!';
    ANSWERS(PLP_ERR_ARGUMENT, plp_preset_find("unobtainium", &preset, sizeof preset));
    ANSWERS(PLP_ERR_ARGUMENT, plp_preset_get(plp_preset_count(), &preset, sizeof preset));
    ANSWERS(PLP_ERR_NULL, plp_preset_find(NULL, &preset, sizeof preset));
    ANSWERS(PLP_ERR_STRUCT_SIZE, plp_preset_find("lung", &preset, 8));
    CHECK(preset.source[0] == '!');
}

static void surfaces_and_fixes(void) {
    const float corners[3][3] = {{0, 0, 0}, {0.01f, 0, 0}, {0, 0.01f, 0}};
    const uint32_t good[3] = {0, 1, 2}, bad[3] = {0, 1, 3};
    plp_surface_source source;
    memset(&source, 0, sizeof source);
    source.kind = PLP_SURFACE_MESH;
    source.positions = &corners[0][0];
    source.vertex_count = 3;
    source.triangles = bad;
    source.triangle_count = 1;

    plp_model_desc desc = good_model();
    desc.surfaces = &source;
    desc.surface_count = 1;
    desc.contact_surface = -1;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    CHECK(strstr(plp_last_error(), "vertex 3") || strstr(plp_last_error(), "triangle 0"));
    source.triangles = good;
    const float nowhere[3][3] = {{0, 0, 0}, {NAN, 0, 0}, {0, 0.01f, 0}}, far[3][3] = {{0, 0, 0}, {3e38f, 0, 0}, {0, 1, 0}};
    source.positions = &nowhere[0][0];
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    source.positions = &far[0][0]; /* not on the tissue */
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    source.positions = &corners[0][0];
    source.position_stride = 4; /* less than three floats */
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    source.position_stride = 0;
    source.vertex_count = 0;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    source.vertex_count = 3;
    source.kind = 9;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    source.kind = PLP_SURFACE_FILE;
    MODEL_ANSWERS(PLP_ERR_NULL);

    const uint16_t absent = 77;
    memset(&source, 0, sizeof source);
    source.kind = PLP_SURFACE_LABELS;
    source.labels = &absent; /* a label that no voxel has */
    source.label_count = 1;
    desc = good_model();
    desc.surfaces = &source;
    desc.surface_count = 1;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    source.labels = NULL;
    MODEL_ANSWERS(PLP_ERR_NULL);

    desc = good_model();
    desc.contact_surface = 1;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    desc = good_model();
    desc.fix_faces = 64;
    MODEL_ANSWERS(PLP_ERR_UNSUPPORTED);
    desc = good_model();
    desc.resample = 2;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);

    plp_fix fix;
    memset(&fix, 0, sizeof fix);
    desc = good_model();
    desc.fixes = &fix;
    desc.fix_count = 1;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
}

static void write_file(const char *path, const void *bytes, size_t count) {
    FILE *file = fopen(path, "wb");
    CHECK(file && fwrite(bytes, 1, count, file) == count && fclose(file) == 0);
}

static void files(void) {
    plp_hu_range range = {-500.0f, -1000.0f, 1, 0};
    plp_model_desc desc = plp_model_desc_default();
    desc.labels_path = "no such file.nii";
    MODEL_ANSWERS(PLP_ERR_IO);
    CHECK(strstr(plp_last_error(), "no such file.nii") != NULL);
    desc.labels_path = "bad \xff name.nii";
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);

    /* The start of a NIfTI header, and a NRRD that promises terabytes. */
    char start[100] = {0x5c, 0x01, 0, 0};
    write_file("truncated.nii", start, sizeof start);
    desc.labels_path = "truncated.nii";
    MODEL_ANSWERS(PLP_ERR_FORMAT);
    const char *hostile = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 1000000 1000000 1000000\n"
                          "spacings: 1 1 1\nencoding: raw\n\nabc";
    write_file("hostile.nrrd", hostile, strlen(hostile));
    desc.labels_path = "hostile.nrrd";
    plp_model *out = (plp_model *)UNTOUCHED;
    plp_status status = plp_model_create(&desc, &out);
    CHECK((status == PLP_ERR_FORMAT || status == PLP_ERR_LIMIT) && out == (plp_model *)UNTOUCHED);

    desc = good_model();
    desc.labels_path = "truncated.nii"; /* two anatomies */
    MODEL_ANSWERS(PLP_ERR_ARGUMENT);
    desc = plp_model_desc_default();
    desc.ct_path = "truncated.nii";
    MODEL_ANSWERS(PLP_ERR_ARGUMENT); /* a CT without ranges */
    desc.hu_ranges = &range;
    desc.hu_range_count = 1;
    MODEL_ANSWERS(PLP_ERR_ARGUMENT); /* an empty range */
}

/* Double precision runs nowhere but on the processor, whatever this machine has. */
static void places(void) {
    plp_model *model = block();
    plp_sim *sim = NULL;
    plp_place place;
    plp_sim_desc desc = plp_sim_desc_default();
    desc.backend = PLP_BACKEND_AUTO;
    desc.precision = PLP_PRECISION_DOUBLE;
    desc.threads = 2;
    ANSWERS(PLP_OK, plp_sim_create(model, &desc, &sim));
    ANSWERS(PLP_ERR_NULL, plp_sim_get_place(sim, NULL, sizeof place));
    ANSWERS(PLP_ERR_STRUCT_SIZE, plp_sim_get_place(sim, &place, 4));
    ANSWERS(PLP_OK, plp_sim_get_place(sim, &place, sizeof place));
    CHECK(place.backend == PLP_BACKEND_CPU && place.device == -1 && strcmp(place.name, "CPU, 2 threads") == 0);
    CHECK(strstr(place.fallback, "single precision") != NULL);
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
    ANSWERS(PLP_OK, plp_sim_create(model, NULL, &sim));
    ANSWERS(PLP_OK, plp_sim_get_place(sim, &place, sizeof place));
    CHECK(place.backend == PLP_BACKEND_CPU && place.fallback[0] == 0);
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
    ANSWERS(PLP_OK, plp_model_destroy(model));

    plp_device_info info;
    ANSWERS(PLP_ERR_NULL, plp_device_get(0, NULL, sizeof info));
    ANSWERS(PLP_ERR_STRUCT_SIZE, plp_device_get(0, &info, sizeof info - 1));
    CHECK(plp_device_get(0xFFFFFFFF, &info, sizeof info) < 0 && plp_last_error()[0] != 0);
}

static void simulations(void) {
    plp_model *model = block();
    plp_sim *sim = (plp_sim *)UNTOUCHED;
    plp_sim_desc desc;

    const double steps[] = {0.0, -1.0, NAN, 1e9};
    for (size_t i = 0; i < sizeof steps / sizeof *steps; ++i) {
        desc = plp_sim_desc_default();
        desc.step_s = steps[i];
        ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    }
    desc = plp_sim_desc_default();
    desc.gravity_m_s2[1] = INFINITY;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc = plp_sim_desc_default();
    desc.flags |= 0x80000000;
    ANSWERS(PLP_ERR_UNSUPPORTED, plp_sim_create(model, &desc, &sim));
    desc = plp_sim_desc_default();
    desc.backend = 3;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc.backend = PLP_BACKEND_AUTO;
    desc.device = 0; /* not for it to choose */
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc.backend = PLP_BACKEND_CPU;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc.backend = PLP_BACKEND_CUDA;
    desc.device = -2;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc.device = 0;
    desc.precision = PLP_PRECISION_DOUBLE;
    ANSWERS(PLP_ERR_UNSUPPORTED, plp_sim_create(model, &desc, &sim));
    desc = plp_sim_desc_default();
    desc.threads = 1000000;
    ANSWERS(PLP_ERR_LIMIT, plp_sim_create(model, &desc, &sim));
    desc = plp_sim_desc_default();
    desc.substeps = UINT32_MAX;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc = plp_sim_desc_default();
    desc.drag_per_s = -1.0;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc = plp_sim_desc_default();
    desc.precision = 7;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc = plp_sim_desc_default();
    desc.method = 2;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc.method = PLP_METHOD_EFG;
    desc.scheme = 2;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc.scheme = PLP_SCHEME_PAPER;
    desc.elasticity = 3;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc.elasticity = PLP_ELASTICITY_LINEAR;
    desc.tolerance = NAN;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc.tolerance = 1e-2;
    desc.max_iterations = 0;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_create(model, &desc, &sim));
    desc.max_iterations = 10;
    CHECK(sim == (plp_sim *)UNTOUCHED);
    plp_statistics now;
    ANSWERS(PLP_OK, plp_sim_create(model, &desc, &sim));
    ANSWERS(PLP_OK, plp_sim_step(sim));
    ANSWERS(PLP_OK, plp_sim_get_statistics(sim, &now, sizeof now));
    CHECK(now.substeps_per_step == 1 && now.stable_substep_s > 1e300 && now.cg_iterations <= 10);
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
    ANSWERS(PLP_ERR_NULL, plp_sim_create(model, NULL, NULL));

    sim = simulation(model);
    double nan3[3] = {0, NAN, 0}, zero3[3] = {0, 0, 0}, up3[3] = {0, 0, 1}, out3[3] = {5, 5, 5};
    uint64_t id = 77, count = 77;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_set_gravity(sim, nan3));
    ANSWERS(PLP_ERR_NULL, plp_sim_set_gravity(sim, NULL));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_settle(sim, NAN, 10, out3));
    CHECK(out3[0] == 5);

    plp_load load = plp_load_default();
    load.kind = 5;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_add_load(sim, &load, &id));
    load = plp_load_default();
    load.at_m[0] = 100.0; /* far outside */
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_add_load(sim, &load, &id));
    load.force_n[0] = NAN;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_add_load(sim, &load, &id));
    load = plp_load_default();
    load.kind = PLP_LOAD_PRESSURE; /* in a box of no size */
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_add_load(sim, &load, &id));
    CHECK(id == 77);
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_remove_load(sim, 0));
    plp_material other = {5e3, 0.4, 1000.0, 0.0, "other"}, absurd = {5e3, 0.6, 1000.0, 0.0, "absurd"};
    plp_fix held = {{plp_pose_at(0.0, 0.0, 0.0), {1.0, 1.0, 0.001}}, PLP_AXIS_ALL, 0}, nowhere = held, nothing = held;
    uint64_t changed = 77;
    ANSWERS(PLP_ERR_NULL, plp_sim_set_material(sim, 1, NULL));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_set_material(sim, 0, &other));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_set_material(sim, 1000, &other));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_set_material(sim, 1, &absurd));
    nowhere.region.pose.position_m[0] = 100.0;
    nothing.axes = 0;
    ANSWERS(PLP_ERR_NULL, plp_sim_fix(sim, NULL, &changed));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_fix(sim, &nowhere, &changed));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_free(sim, &nothing, &changed));
    CHECK(changed == 77);
    ANSWERS(PLP_ERR_NULL, plp_sim_grasp(sim, NULL, 0.001, &changed));
    ANSWERS(PLP_ERR_INVALID_HANDLE, plp_sim_release(sim, (plp_tool *)sim, NULL));
    plp_event event;
    ANSWERS(PLP_ERR_STRUCT_SIZE, plp_sim_poll_event(sim, &event, 3));
    ANSWERS(PLP_NOTHING, plp_sim_poll_event(sim, &event, sizeof event));
    plp_thread_desc lagging = plp_thread_desc_default();
    lagging.longest_lag_s = NAN;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_start(sim, &lagging));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_remove_load(sim, 12345));

    plp_pose pose = plp_pose_at(0, 0, 0);
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_drive_region(sim, 1, &pose)); /* tissue, not a rigid region */
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_drive_region(sim, 70000, &pose));
    ANSWERS(PLP_ERR_NULL, plp_sim_drive_region(sim, 1, NULL));

    plp_pick pick;
    pick.distance_m = 77;
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_pick(sim, zero3, zero3, &pick));
    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_pick(sim, nan3, up3, &pick));
    double away[3] = {1, 1, 1};
    ANSWERS(PLP_NOTHING, plp_sim_pick(sim, away, up3, &pick));
    CHECK(pick.distance_m == 77);

    ANSWERS(PLP_ERR_ARGUMENT, plp_sim_get_nodes(sim, 9, NULL, 0, &count));
    ANSWERS(PLP_ERR_NULL, plp_sim_get_nodes(sim, PLP_NODES_VELOCITY, NULL, 1, &count));
    CHECK(count == 77);
    ANSWERS(PLP_TRUNCATED, plp_sim_get_nodes(sim, PLP_NODES_REST_POSITION, NULL, 0, &count));
    CHECK(count == 9 * 9 * 9);
    plp_statistics statistics;
    ANSWERS(PLP_ERR_STRUCT_SIZE, plp_sim_get_statistics(sim, &statistics, 0));
    plp_latency latency;
    ANSWERS(PLP_ERR_STRUCT_SIZE, plp_sim_get_latency(sim, &latency, sizeof latency - 1));
    ANSWERS(PLP_ERR_NULL, plp_sim_get_latency(sim, NULL, sizeof latency));
    ANSWERS(PLP_ERR_NULL, plp_sim_get_energy(sim, NULL, sizeof(plp_energy)));

    ANSWERS(PLP_OK, plp_sim_destroy(sim));
    ANSWERS(PLP_OK, plp_model_destroy(model));
}

static void tools_and_surfaces(void) {
    plp_model *model = block();
    plp_sim *sim = simulation(model);
    plp_tool *tool = (plp_tool *)UNTOUCHED;
    plp_tool_part parts[17];
    for (int i = 0; i < 17; ++i) {
        parts[i] = plp_sphere(0.01);
    }
    plp_tool_desc desc = plp_tool_desc_default();
    ANSWERS(PLP_ERR_ARGUMENT, plp_tool_create(sim, &desc, &tool)); /* no parts */
    desc.part_count = 1;
    ANSWERS(PLP_ERR_NULL, plp_tool_create(sim, &desc, &tool));
    desc.parts = parts;
    desc.part_count = 17;
    ANSWERS(PLP_ERR_ARGUMENT, plp_tool_create(sim, &desc, &tool));
    desc.part_count = 1;
    desc.friction = NAN;
    ANSWERS(PLP_ERR_ARGUMENT, plp_tool_create(sim, &desc, &tool));
    desc.friction = 1e300;
    ANSWERS(PLP_ERR_ARGUMENT, plp_tool_create(sim, &desc, &tool));
    desc.friction = 0;
    parts[0].pose.position_m[1] = 1e300;
    ANSWERS(PLP_ERR_ARGUMENT, plp_tool_create(sim, &desc, &tool));
    parts[0] = plp_sphere(0.01);
    parts[0].radius_m = 0;
    ANSWERS(PLP_ERR_ARGUMENT, plp_tool_create(sim, &desc, &tool));
    parts[0] = plp_sphere(0.01);
    parts[0].kind = 7;
    ANSWERS(PLP_ERR_ARGUMENT, plp_tool_create(sim, &desc, &tool));
    parts[0] = plp_sphere(0.01);
    memset(parts[0].pose.rotation, 0, sizeof parts[0].pose.rotation);
    ANSWERS(PLP_ERR_ARGUMENT, plp_tool_create(sim, &desc, &tool));
    CHECK(tool == (plp_tool *)UNTOUCHED);

    /* A bad pose leaves the tool where it was. */
    tool = ball(sim);
    plp_motion motion = plp_motion_at(0.02, 0.02, 0.3);
    plp_force force;
    CHECK(plp_tool_set_pose(tool, &motion) == PLP_OK);
    ANSWERS(PLP_OK, plp_sim_step(sim));
    motion.pose.position_m[2] = NAN;
    CHECK(plp_tool_set_pose(tool, &motion) == PLP_ERR_ARGUMENT);
    motion = plp_motion_at(1e6, 0, 0);
    CHECK(plp_tool_set_pose(tool, &motion) == PLP_ERR_ARGUMENT);
    motion = plp_motion_at(0, 0, 0);
    motion.linear_m_s[0] = INFINITY;
    CHECK(plp_tool_set_pose(tool, &motion) == PLP_ERR_ARGUMENT);
    motion = plp_motion_at(0, 0, 0);
    memset(motion.pose.rotation, 0, sizeof motion.pose.rotation);
    CHECK(plp_tool_set_pose(tool, &motion) == PLP_ERR_ARGUMENT);
    ANSWERS(PLP_OK, plp_sim_step(sim));
    CHECK(plp_tool_get_force(tool, &force) == PLP_OK);
    CHECK(force.motion.pose.position_m[2] == 0.3);

    plp_surface *surface = (plp_surface *)UNTOUCHED;
    plp_surface_view view;
    ANSWERS(PLP_ERR_ARGUMENT, plp_surface_create(sim, 1000, &surface));
    CHECK(surface == (plp_surface *)UNTOUCHED);
    ANSWERS(PLP_OK, plp_surface_create(sim, 0, &surface));
    ANSWERS(PLP_ERR_STATE, plp_surface_unmap(surface));
    ANSWERS(PLP_ERR_STRUCT_SIZE, plp_surface_map(surface, &view, 1));
    ANSWERS(PLP_OK, plp_surface_map(surface, &view, sizeof view));
    ANSWERS(PLP_ERR_STATE, plp_surface_map(surface, &view, sizeof view));
    ANSWERS(PLP_ERR_STATE, plp_surface_set_field(surface, PLP_FIELD_STRAIN));
    ANSWERS(PLP_OK, plp_surface_unmap(surface));
    ANSWERS(PLP_ERR_ARGUMENT, plp_surface_set_field(surface, 99));
    ANSWERS(PLP_OK, plp_surface_destroy(surface));
    ANSWERS(PLP_OK, plp_tool_destroy(tool));

    /* A port that never saw a frame has none to show. */
    ANSWERS(PLP_OK, plp_surface_create(sim, 0, &surface));
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
    ANSWERS(PLP_ERR_STATE, plp_surface_map(surface, &view, sizeof view));
    ANSWERS(PLP_OK, plp_surface_destroy(surface));
    ANSWERS(PLP_OK, plp_model_destroy(model));
}

static int32_t cancel(void *user, float fraction, const char *stage) {
    CHECK(fraction >= 0.0f && fraction <= 1.0f && stage[0] != 0);
    return ++*(int *)user == 2;
}

static void cancelling(void) {
    int calls = 0;
    plp_model_desc desc = good_model();
    desc.progress = cancel;
    desc.progress_user = &calls;
    MODEL_ANSWERS(PLP_ERR_CANCELLED);
    CHECK(calls == 2);
}

int main(void) {
    CHECK(plp_check_abi() == PLP_OK && plp_last_error()[0] == 0);
    CHECK(strncmp(plp_build_string(), "kernels ", 8) == 0 && plp_has("cuda") == 1);
    CHECK(plp_has("lattice") == 1 && plp_has("teleportation") == 0 && plp_has(NULL) == 0);
    CHECK(strcmp(plp_status_name(PLP_ERR_BUSY), "PLP_ERR_BUSY") == 0 && plp_status_name(4711) != NULL);
    grids();
    labels_and_materials();
    surfaces_and_fixes();
    files();
    cancelling();
    struct_sizes();
    handles();
    places();
    simulations();
    tools_and_surfaces();
    puts("bad input: ok");
    return 0;
}
