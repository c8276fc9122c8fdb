/* Presses a ball into a chest from the front, prints one table and writes palpation.csv.
 *
 *   palpation                                       a generated thorax
 *   palpation LABELS.nii.gz 1=lung 4=muscle 9=bone  a label file; bone is rigid, what is not named is empty
 */
#include <palpate/palpate.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double RADIUS_M = 0.010, SPEED_M_S = 0.1, DEPTH_M = 0.020;

static void check(plp_status status) {
    if (status >= 0) return;
    fprintf(stderr, "%s: %s\n", plp_status_name(status), plp_last_error());
    exit(1);
}

static int32_t show_progress(void *user, float fraction, const char *stage) {
    (void)user;
    fprintf(stderr, "\rbuilding: %3.0f %% %-40s", 100.0 * fraction, stage);
    return 0;
}

int main(int argc, char **argv) {
    plp_model *model = NULL;
    plp_sim *sim = NULL;
    plp_tool *tool = NULL;
    check(plp_check_abi());

    /* The model: what each label is, and which nodes are held. */
    plp_model_desc anatomy = plp_model_desc_default();
    plp_label_use uses[256] = {{0}};
    anatomy.progress = show_progress;
    if (argc > 1) {
        anatomy.labels_path = argv[1];
        for (uint32_t label = 0; label < 256; ++label) uses[label].label = label; /* PLP_USE_EMPTY */
        for (int i = 2; i < argc; ++i) {
            uint32_t label = (uint32_t)atoi(argv[i]) % 256, length = (uint32_t)strcspn(argv[i], "=");
            const char *name = argv[i] + length + (argv[i][length] == '=');
            uses[label] = plp_label_as(label, strcmp(name, "bone") ? PLP_USE_TISSUE : PLP_USE_RIGID, name);
        }
        anatomy.uses = uses;
        anatomy.use_count = 256;
        anatomy.cell_m = 0.0045;
        /* The grid's faces, and a file may be stored either way round: not the front, nor the back, where the spine holds. */
        anatomy.fix_faces = 63 & ~(uint32_t)(PLP_FACE_Y_LOW | PLP_FACE_Y_HIGH);
        anatomy.young_cap_pa = 100e3;
    }
    check(plp_model_create(&anatomy, &model));
    fprintf(stderr, "\n");

    /* The simulation, and a ball that waits where a ray from the front meets the skin. */
    plp_model_info info;
    check(plp_model_get_info(model, &info, sizeof info));
    const double *low = info.bounds_min_m, *high = info.bounds_max_m, backwards[3] = {0.0, -1.0, 0.0};
    const double eye[3] = {0.5 * (low[0] + high[0]), high[1] + 0.1, 0.75 * low[2] + 0.25 * high[2]};
    plp_tool_part ball = plp_sphere(RADIUS_M);
    plp_tool_desc probe = plp_tool_desc_default();
    probe.parts = &ball;
    probe.part_count = 1;
    plp_sim_desc settings = plp_sim_desc_default();
    plp_pick skin;
    check(plp_sim_create(model, &settings, &sim));
    check(plp_tool_create(sim, &probe, &tool));
    if (plp_sim_pick(sim, eye, backwards, &skin) != PLP_OK) return 1; /* nothing to press */

    /* Press. */
    double indentation = 0.0, peak = 0.0;
    FILE *csv = fopen("palpation.csv", "w");
    if (!csv) return 1;
    fprintf(csv, "indentation_m,force_n\n");
    for (int step = 1; indentation < DEPTH_M; ++step) {
        plp_force force;
        indentation = SPEED_M_S * settings.step_s * step;
        double y = skin.point_m[1] + RADIUS_M - indentation;
        plp_motion motion = plp_motion_at(skin.point_m[0], y, skin.point_m[2]);
        motion.linear_m_s[1] = -SPEED_M_S;
        check(plp_tool_set_pose(tool, &motion));
        check(plp_sim_step(sim));
        check(plp_tool_get_force(tool, &force));
        peak = force.force_n[1] > peak ? force.force_n[1] : peak;
        fprintf(csv, "%.6f,%.6f\n", indentation, force.force_n[1]);
    }
    fclose(csv);
    plp_statistics now; plp_energy energy; plp_place place;
    check(plp_sim_get_place(sim, &place, sizeof place));
    check(plp_sim_get_statistics(sim, &now, sizeof now));
    check(plp_sim_get_energy(sim, &energy, sizeof energy));
    printf("runs on           %s\nnodes             %llu\n", place.name, (unsigned long long)now.node_count);
    printf("substeps per step %u\nreal-time factor  %.2f\n", now.substeps_per_step, now.real_time_factor);
    printf("peak force        %.3f N\nindentation       %.1f mm\n", peak, 1e3 * indentation);
    printf("elastic energy    %.4f J\n", energy.elastic_j);

    plp_tool_destroy(tool);
    plp_sim_destroy(sim);
    plp_model_destroy(model);
    return 0;
}
