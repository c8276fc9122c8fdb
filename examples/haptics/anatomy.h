// The chest, and where on it the device's workspace lies.
#pragma once

#include <cmath>
#include <cstdint>

#include "check.h"
#include "options.h"

constexpr double RADIUS_M = 0.010, CLEARANCE_M = 0.010;

/// The face of the model's grid that looks to the front, +y of the world, as a bit of fix_faces: the axes of files run either way.
inline std::uint32_t front_face(const plp_model *model) {
    plp_model_info info;
    check(plp_model_get_info(model, &info, sizeof info));
    const double *q = info.frame.rotation;
    // The world's y in the axes of the grid: a row of its rotation.
    const double front[3] = {2.0 * (q[0] * q[1] + q[3] * q[2]), 1.0 - 2.0 * (q[0] * q[0] + q[2] * q[2]),
                             2.0 * (q[1] * q[2] - q[3] * q[0])};
    int axis = 0;
    for (int i = 1; i < 3; ++i) {
        if (std::fabs(front[i]) > std::fabs(front[axis])) axis = i;
    }
    return static_cast<std::uint32_t>(PLP_FACE_X_LOW) << (2 * axis + (front[axis] > 0.0));
}

/// The generated chest, or a label file with what its labels are.
inline plp_model *build(const Options &options) {
    plp_model_desc anatomy = plp_model_desc_default();
    std::vector<plp_label_use> uses;
    anatomy.cell_m = options.cell_m;
    anatomy.young_cap_pa = options.young_cap_pa;
    if (!options.labels.empty()) {
        // Bone is rigid, what is not named is empty, and all faces but the front are held.
        for (std::uint32_t label = 0; label < 256; ++label) uses.push_back(plp_label_as(label, PLP_USE_EMPTY, nullptr));
        for (const std::string &use : options.uses) {
            const auto label = static_cast<std::uint32_t>(std::atoi(use.c_str())) % 256;
            const std::string name = use.substr(use.find('=') + 1);
            uses[label] = plp_label_as(label, name == "bone" ? PLP_USE_RIGID : PLP_USE_TISSUE, name.c_str());
        }
        anatomy.labels_path = options.labels.c_str();
        anatomy.uses = uses.data();
        anatomy.use_count = static_cast<std::uint32_t>(uses.size());
    }
    plp_model *model = nullptr;
    check(plp_model_create(&anatomy, &model));
    if (!options.labels.empty()) {
        // Which face is the front is known when the file has been read.
        anatomy.fix_faces = 63 & ~front_face(model);
        check(plp_model_destroy(model));
        check(plp_model_create(&anatomy, &model));
    }
    return model;
}

/// Where a ray from the front meets the chest. By default it goes through the middle of its breadth and a quarter of its
/// height: below the breast bone, where there is soft tissue to press.
inline plp_pick find_skin(const plp_model *model, const plp_sim *sim, const Options &options) {
    plp_model_info info;
    check(plp_model_get_info(model, &info, sizeof info));
    const double *low = info.bounds_min_m, *high = info.bounds_max_m, backwards[3] = {0.0, -1.0, 0.0};
    const double eye[3] = {low[0] + options.across * (high[0] - low[0]), high[1] + 0.1,
                           low[2] + options.up * (high[2] - low[2])};
    plp_pick skin;
    if (plp_sim_pick(sim, eye, backwards, &skin) == PLP_OK) return skin;
    std::fprintf(stderr, "there is nothing to press at --at %.2f,%.2f\n", options.across, options.up);
    std::exit(1);
}

/// The user faces the chest: away from the user (-z of the device) is into it (-y of the world), and up is its head.
/// The device's origin lies before the skin.
inline plp_hd_mapping map_workspace(const plp_pick &skin, double scale) {
    plp_hd_mapping mapping = plp_hd_desc_default().mapping;
    const double half = std::sqrt(0.5);
    mapping.base = plp_pose_at(skin.point_m[0], skin.point_m[1] + RADIUS_M + CLEARANCE_M * scale, skin.point_m[2]);
    // Half a turn about the line between y and z exchanges these two, and turns x round: the patient faces the user, and
    // has its right where the user has the left.
    mapping.base.rotation[0] = 0.0;
    mapping.base.rotation[1] = half;
    mapping.base.rotation[2] = half;
    mapping.base.rotation[3] = 0.0;
    mapping.scale = scale;
    return mapping;
}
