#ifndef PALPATE_H
#define PALPATE_H

/*
 * palpate: soft tissue that can be seen, touched and cut in real time.
 *
 * Five things, each an opaque pointer that a create call gives you and that you give back to its destroy
 * call, in any order:
 *
 *   plp_model     anatomy with materials, at rest; immutable, shared by any number of simulations and threads
 *   plp_sim       a running simulation; one thread at a time steps it
 *   plp_tool      a rigid tool in a simulation; a servo thread of its own sets its pose and reads its force
 *   plp_surface   a moving surface of a simulation; a render thread of its own maps its vertices
 *   plp_snapshot  what a simulation was at one instant, to go back to
 *
 *      servo thread                      simulation thread                     render thread
 *   plp_tool_set_pose   -- pose -->         plp_sim_step     -- vertices -->   plp_surface_map
 *   plp_tool_get_force  <-- force --                                           plp_surface_unmap
 *
 * That force is what tissue and tool give each other, whatever it is. What goes to the motors of a haptic device is bounded first: there
 * plp_tool_exchange takes the place of both.
 *
 * A whole program, which presses a ball of 10 mm into a generated chest from the front:
 *
 *   #include <palpate/palpate.h>
 *   #include <stdio.h>
 *
 *   int main(void) {
 *       plp_model_desc chest = plp_model_desc_default();
 *       plp_model *model = NULL;
 *       plp_sim *sim = NULL;
 *       plp_tool *tool = NULL;
 *       plp_tool_part ball = plp_sphere(0.010);
 *       plp_tool_desc probe = plp_tool_desc_default();
 *       probe.parts = &ball;
 *       probe.part_count = 1;
 *       if (plp_model_create(&chest, &model) < 0 || plp_sim_create(model, NULL, &sim) < 0 ||
 *           plp_tool_create(sim, &probe, &tool) < 0) {
 *           printf("%s\n", plp_last_error());
 *           return 1;
 *       }
 *       for (int step = 0; step < 200; ++step) {                  // 0.2 s at 0.1 m/s, metres and seconds
 *           plp_motion motion = plp_motion_at(0.0, 0.11 - 1e-4 * step, -0.06);
 *           plp_force force;
 *           plp_tool_set_pose(tool, &motion);
 *           plp_sim_step(sim);
 *           plp_tool_get_force(tool, &force);
 *           printf("%g N\n", force.force_n[1]);
 *       }
 *       plp_tool_destroy(tool);
 *       plp_sim_destroy(sim);
 *       plp_model_destroy(model);
 *   }
 *
 * Statuses below 0 are errors: no output was written, unless a function says otherwise, and plp_last_error()
 * has a sentence about it, but for functions marked @rt: there plp_status_name() has a few words. SI units;
 * right-handed frames; quaternions are x, y, z, w; strings are UTF-8. Pointers must not be NULL unless marked
 * @nullable. Functions are marked:
 *
 *   @thread any     from any thread, at any time
 *   @thread owner   from one thread at a time for each simulation
 *   @thread port    from one thread at a time for each tool or surface, while others do as they like
 *   @rt             no lock, no allocation, no system call, bounded time; leaves plp_last_error() alone
 *
 * README.md, beside this header's folder, states all rules on one page.
 */


/* Generated from src/capi by `PALPATE_BLESS=1 cargo test --test header`: do not edit. */

#include <stddef.h>
#include <stdint.h>

/// The version of this header's binary interface. It only changes when programs must be compiled again; the
/// shared library's SONAME carries it.
#define PLP_ABI_VERSION 1

/// A bit of plp_fix.axes: the model's x axis.
#define PLP_AXIS_X 1

/// A bit of plp_fix.axes: the model's y axis.
#define PLP_AXIS_Y 2

/// A bit of plp_fix.axes: the model's z axis.
#define PLP_AXIS_Z 4

/// All three axes.
#define PLP_AXIS_ALL 7

/// A log line that a curious user wants to know.
#define PLP_LOG_INFO 0

/// A log line that a user should act on, or know before trusting a result.
#define PLP_LOG_WARNING 1

/// A simulation runs on the processor, which does all that the library can do.
#define PLP_BACKEND_CPU 0

/// A simulation runs on an NVIDIA GPU, the lattice in single precision, or is not created.
#define PLP_BACKEND_CUDA 1

/// A simulation runs on the first NVIDIA GPU that can run it, otherwise on the processor; plp_sim_get_place says why.
/// This is decided once, by plp_sim_create.
#define PLP_BACKEND_AUTO 2

/// The simulation diverged: its tools feel nothing until plp_sim_reset. On its own thread it is paused.
#define PLP_EVENT_DIVERGED 1

/// The GPU was lost: the simulation can only be destroyed.
#define PLP_EVENT_DEVICE_LOST 2

/// The simulation's own thread fell so far behind that it let `value` seconds go.
#define PLP_EVENT_FELL_BEHIND 3

/// The servo of a tool's device has not called for a fifth of a second: the tool stands where it was.
#define PLP_EVENT_SERVO_SILENT 4

/// The buttons of a tool's device have changed, to `buttons`.
#define PLP_EVENT_BUTTONS 5

/// A cut of a tool's blade was refused: the room of plp_sim_desc.cut_nodes is spent. Told once for each tool, until a reset.
#define PLP_EVENT_CUT_REFUSED 6

/// Surface number `value` does not show the last cuts: it is not closed where they meet it, or its room is spent. The tissue is cut all the same. Told once, until it follows.
#define PLP_EVENT_SURFACE_BEHIND 7

/// A label's voxels become nothing: air, gas, outside.
#define PLP_USE_EMPTY 0

/// A label's voxels become deformable tissue.
#define PLP_USE_TISSUE 1

/// A label's voxels become a rigid region, such as a bone: held in place until plp_sim_drive_region moves it.
#define PLP_USE_RIGID 2

/// A bit of plp_model_desc.fix_faces: all nodes on the grid's low x face are held.
#define PLP_FACE_X_LOW 1

/// A bit of plp_model_desc.fix_faces: the high x face.
#define PLP_FACE_X_HIGH 2

/// A bit of plp_model_desc.fix_faces: the low y face.
#define PLP_FACE_Y_LOW 4

/// A bit of plp_model_desc.fix_faces: the high y face.
#define PLP_FACE_Y_HIGH 8

/// A bit of plp_model_desc.fix_faces: the low z face.
#define PLP_FACE_Z_LOW 16

/// A bit of plp_model_desc.fix_faces: the high z face.
#define PLP_FACE_Z_HIGH 32

/// A surface is extracted from the labels and smoothed: it runs within half a cell of their border, which it
/// does not follow exactly. Where that matters, give a mesh.
#define PLP_SURFACE_LABELS 0

/// A surface is a mesh in memory.
#define PLP_SURFACE_MESH 1

/// A surface is a mesh file: OBJ, STL or PLY.
#define PLP_SURFACE_FILE 2

/// A cell takes the label that fills the largest part of it.
#define PLP_RESAMPLE_MAJORITY 0

/// A cell takes the label of the voxel at its centre.
#define PLP_RESAMPLE_NEAREST 1

/// The tool hangs on a spring between it and the device (default): stiff tissue, such as bone, is safe, and soft tissue feels a little softer.
#define PLP_COUPLING_VIRTUAL 0

/// The tool is where the device is: soft tissue feels as soft as it is, and nothing may be stiffer than the device renders.
#define PLP_COUPLING_DIRECT 1

/// A bit of plp_haptic_desc.flags (default on): damping is added where the loop has given the hand more energy than it got.
#define PLP_HAPTIC_PASSIVE 1

/// A bit of plp_haptic_desc.flags (default on): workspace_m[0] is the radius of a ball; without it workspace_m are half the edges of a box.
#define PLP_HAPTIC_BALL 2

/// A bit of plp_haptic_state.flags: the dead-man switch is not held, and there shall be no force.
#define PLP_HAPTIC_RELEASED 1

/// A bit of plp_servo.flags: the motion, the time stamp or the contact model was not finite, or time went backwards or stood
/// still. No force, until the tool engages again.
#define PLP_SERVO_NOT_FINITE 1

/// The servo loop paused. No force, until the tool engages again.
#define PLP_SERVO_PAUSED (1 << 1)

/// The simulation is gone, has failed or was reset. No force, until the tool engages again.
#define PLP_SERVO_STOPPED (1 << 2)

/// The newest step is old: the last force is held and no longer follows the tool.
#define PLP_SERVO_HELD (1 << 3)

/// It is so old that the force decays, or is gone.
#define PLP_SERVO_DECAYING (1 << 4)

/// The device moved faster than is believed. No force, until the tool engages again.
#define PLP_SERVO_TOO_FAST (1 << 5)

/// There is no force yet: the tool engages when the force has been small for a tenth of a second.
#define PLP_SERVO_WAITING (1 << 6)

/// The force is rising to its full share after the tool engaged.
#define PLP_SERVO_RAMPING (1 << 7)

/// The force was lowered to what the motors bear for long.
#define PLP_SERVO_AVERAGED (1 << 8)

/// Force or torque was clamped to the device's largest.
#define PLP_SERVO_CLAMPED (1 << 9)

/// Force or torque changed as fast as it may, and is not where it should be yet.
#define PLP_SERVO_SLEWED (1 << 10)

/// The dead-man switch is not held. No force at once, until the tool engages again.
#define PLP_SERVO_RELEASED (1 << 11)

/// Damping was added to keep the loop passive.
#define PLP_SERVO_DAMPED (1 << 12)

/// Steps compute in 32-bit floating point.
#define PLP_PRECISION_SINGLE 0

/// Steps compute in 64-bit floating point.
#define PLP_PRECISION_DOUBLE 1

/// The calibrated lattice of springs computes the tissue, by explicit substeps.
#define PLP_METHOD_LATTICE 0

/// The meshless (element-free Galerkin) model computes the tissue, by implicit steps.
#define PLP_METHOD_EFG 1

/// Hooke's law in axes that turn with each cell.
#define PLP_ELASTICITY_COROTATED 0

/// Hooke's law for small rotations: tissue that turns is strained.
#define PLP_ELASTICITY_LINEAR 1

/// Hooke's law between Green's strain and the second Piola-Kirchhoff stress.
#define PLP_ELASTICITY_ST_VENANT_KIRCHHOFF 2

/// Backward Euler: stable for any step, damps what swings faster than the step.
#define PLP_SCHEME_BACKWARD_EULER 0

/// The scheme as Magnoux and Ozell (2021) print it: stable for any step, damps nothing.
#define PLP_SCHEME_PAPER 1

/// A bit of plp_sim_desc.flags (default on): quiet regions fall asleep and stay as anchors.
#define PLP_SIM_SLEEPING 1

/// A bit of plp_sim_desc.flags (default on): the model's rest shape already balances gravity_m_s2, so that
/// nothing sags at the start.
#define PLP_SIM_REST_UNDER_GRAVITY 2

/// A force at a material point.
#define PLP_LOAD_POINT 0

/// A force per rest area on boundary faces of cells, of constant direction.
#define PLP_LOAD_TRACTION 1

/// A pressure on boundary faces of cells; it pushes against the outward normal and follows the deformed
/// surface.
#define PLP_LOAD_PRESSURE 2

/// Buckets of plp_latency.
#define PLP_LATENCY_BUCKETS 82

/// Rest positions of nodes in metres, world frame.
#define PLP_NODES_REST_POSITION 0

/// Displacements of nodes in metres, world axes.
#define PLP_NODES_DISPLACEMENT 1

/// Velocities of nodes in m/s, world axes.
#define PLP_NODES_VELOCITY 2

/// A surface's scalar is the length of the displacement in metres.
#define PLP_FIELD_DISPLACEMENT 0

/// A surface's scalar is the largest principal strain under the vertex.
#define PLP_FIELD_STRAIN 1

/// A ball of radius_m.
#define PLP_SHAPE_SPHERE 0

/// A ball of radius_m swept along local z, over half_length_m both ways.
#define PLP_SHAPE_CAPSULE 1

/// A box of half_extents_m whose edges are rounded by radius_m.
#define PLP_SHAPE_BOX 2

/// A model: tissue at rest, immutable. Any number of threads and simulations may share it.
typedef struct plp_model plp_model;

/// A running simulation. One thread at a time.
typedef struct plp_sim plp_sim;

/// What a simulation was at one instant. Immutable; any number of threads and simulations may share it.
typedef struct plp_snapshot plp_snapshot;

/// A render surface of a simulation: the port of one render thread. Works while the simulation steps on
/// another thread.
typedef struct plp_surface plp_surface;

/// A tool of a simulation: the port of one servo thread. Works while the simulation steps on another thread.
typedef struct plp_tool plp_tool;

/// What a call answers: 0 on success, negative on error, positive on success with a remark.
/// A call that answers an error has written none of its outputs, and changed nothing unless it was the
/// simulation that failed: PLP_ERR_DIVERGED, PLP_ERR_DEVICE, PLP_ERR_PANIC.
typedef int32_t plp_status;

/// An isotropic, linearly elastic material at small strain.
typedef struct {
    /// Young's modulus in Pa, 1 to 1e12.
    double young_pa;
    /// Poisson's ratio, in [0.25, 0.5).
    double poisson;
    /// Density in kg/m^3, 1 to 30,000.
    double density_kg_m3;
    /// Stiffness-proportional damping in seconds, 0 (as in presets) to 1: a spring of stiffness k resists with
    /// damping_s * k times its rate of length. It shortens the stable substep.
    double damping_s;
    /// A name for tables and pictures, UTF-8, ended by NUL.
    char name[64];
} plp_material;

/// A material preset and where its numbers come from.
typedef struct {
    /// The material; its name is the preset's.
    plp_material material;
    /// The publications that the numbers are taken from, and which of them are estimates, UTF-8, ended by NUL.
    char source[512];
} plp_preset;

/// A position and an orientation. A pose "of" a thing maps the thing's frame to the world.
typedef struct {
    /// Position in metres.
    double position_m[3];
    /// Unit quaternion x, y, z, w; (0, 0, 0, 1) is no rotation. Normalised by the library; refused when its
    /// length is not within 0.9 to 1.1.
    double rotation[4];
} plp_pose;

/// A grid of labels in memory: one integer for each voxel. Copied during the call.
///
/// Voxel (i, j, k) is labels[i + nx * (j + ny * k)]. Its centre lies at frame * (i * sx, j * sy, k * sz), or
/// at index_to_world * (i, j, k, 1).
typedef struct {
    /// The labels, x fastest.
    const void *labels;
    /// Bytes of one label: 1 (uint8_t) or 2 (uint16_t).
    uint32_t label_bytes;
    /// Voxels along x, y, z.
    uint32_t voxels[3];
    /// Distance of neighbouring voxel centres along x, y, z in metres, each 1e-6 to 1.
    double spacing_m[3];
    /// The grid's axes, and the centre of voxel (0, 0, 0).
    plp_pose frame;
    /// 12 doubles, 3 rows of 4, to metres: replaces spacing_m and frame. Mirrored axes are welcome, sheared
    /// ones are refused.
    /// @nullable
    const double *index_to_world;
} plp_label_grid;

/// The label of CT voxels from low_hu to high_hu.
typedef struct {
    /// Lowest value in Hounsfield units, included.
    float low_hu;
    /// Highest value in Hounsfield units, included.
    float high_hu;
    /// The label, up to 65535.
    uint32_t label;
    /// Must be 0.
    uint32_t reserved;
} plp_hu_range;

/// What the voxels of one label become.
typedef struct {
    /// The label, up to 65535.
    uint32_t label;
    /// PLP_USE_EMPTY, PLP_USE_TISSUE or PLP_USE_RIGID.
    uint32_t kind;
    /// The material; not read for PLP_USE_EMPTY. Equal materials of several labels count once; a model has at
    /// most 15.
    plp_material material;
} plp_label_use;

/// A box that may be turned: the set of points within half_extents_m of the centre along the pose's axes.
typedef struct {
    /// Centre and axes.
    plp_pose pose;
    /// Half the edge lengths in metres.
    double half_extents_m[3];
} plp_box;

/// Nodes that are held: those whose rest position lies in a box.
typedef struct {
    /// The box.
    plp_box region;
    /// Which axes of the model frame (plp_model_info.frame) are held: PLP_AXIS_X and so on, or'ed.
    uint32_t axes;
    /// Must be 0.
    uint32_t reserved;
} plp_fix;

/// Where a render surface comes from. A zeroed one is the smoothed boundary of everything that is not empty.
typedef struct {
    /// PLP_SURFACE_LABELS, PLP_SURFACE_MESH or PLP_SURFACE_FILE; it says which of the fields below are read.
    uint32_t kind;
    /// LABELS: how many; 0 takes all labels that are not empty.
    uint32_t label_count;
    /// LABELS: the labels whose union's boundary is wanted. @nullable
    const uint16_t *labels;
    /// MESH: x, y, z in metres, world frame.
    const float *positions;
    /// MESH: texture coordinates u, v. @nullable
    const float *uvs;
    /// MESH: three vertex indices for each triangle, counter-clockwise seen from outside.
    const uint32_t *triangles;
    /// MESH: how many vertices.
    uint32_t vertex_count;
    /// MESH: how many triangles.
    uint32_t triangle_count;
    /// MESH: bytes from one position to the next; 0 means tightly packed, 12.
    uint32_t position_stride;
    /// MESH: bytes from one texture coordinate to the next; 0 means tightly packed, 8.
    uint32_t uv_stride;
    /// FILE: its path, UTF-8.
    const char *path;
    /// FILE: metres for each unit of the file, such as 0.001 for millimetres.
    double scale_to_m;
} plp_surface_source;

/// Told how far a long call has come: a fraction in [0, 1] and the name of the stage (valid during the
/// callback). Returns 0 to go on, anything else to cancel the call, which then answers PLP_ERR_CANCELLED.
/// Called on the calling thread. Must not throw or longjmp.
typedef int32_t (*plp_progress_fn)(void *user, float fraction, const char *stage);

/// Told what the library has to say: PLP_LOG_INFO or PLP_LOG_WARNING, and one line of UTF-8 without a line
/// end (valid during the callback). Called on the thread of, and within, the call that caused the line; never
/// from @rt functions. Must not throw or longjmp.
typedef void (*plp_log_fn)(void *user, int32_t level, const char *line);

/// What a model is built from. Fill it with plp_model_desc_init (or plp_model_desc_default), then change what
/// you need.
///
/// The anatomy is the one that is given of grid, labels_path, ct_path and solid; giving two is an error. Without
/// any, it is a generated thorax: lungs with airways and vessels, a tumour, ribs, with materials and fixing
/// of its own, so that a desc of nothing but defaults builds. It fills a box of 0.30 x 0.20 x 0.24 m around the
/// origin, x to the right of the body, y to its front, z to its head; at (0, y, -0.06) its skin is met
/// at y = 0.096 with cells of 6 mm, the default, and up to a centimetre further out with others; plp_sim_pick finds it.
typedef struct {
    /// The size of this struct as the caller knows it.
    uint32_t struct_size;
    /// How a cell takes its label from the voxels: PLP_RESAMPLE_MAJORITY (default) or PLP_RESAMPLE_NEAREST.
    uint32_t resample;
    /// Labels in memory. @nullable
    const plp_label_grid *grid;
    /// A label file: NIfTI (.nii, .nii.gz) or NRRD (.nrrd). @nullable
    const char *labels_path;
    /// A CT file in Hounsfield units, same formats, made into labels by hu_ranges. @nullable
    const char *ct_path;
    /// Ranges of Hounsfield units [hu_range_count]; the first that fits gives the label, none gives 0.
    /// @nullable
    const plp_hu_range *hu_ranges;
    /// What each label becomes [use_count]. Every label that occurs must be named, except for the generated
    /// thorax. @nullable
    const plp_label_use *uses;
    /// Nodes that are held, besides rigid regions [fix_count]. @nullable
    const plp_fix *fixes;
    /// Render surfaces [surface_count], numbered in this order. NULL with a count of 0 makes one surface of
    /// all labels. @nullable
    const plp_surface_source *surfaces;
    /// Number of hu_ranges.
    uint32_t hu_range_count;
    /// Number of uses.
    uint32_t use_count;
    /// Number of fixes.
    uint32_t fix_count;
    /// Number of surfaces.
    uint32_t surface_count;
    /// Faces of the grid whose nodes are held: PLP_FACE_X_LOW and so on, or'ed.
    uint32_t fix_faces;
    /// Which of surfaces tools touch (default 0); -1 extracts one of all labels for it.
    int32_t contact_surface;
    /// Edge length of a cell in metres; 0 (default) takes the smallest voxel spacing, and 6 mm for the
    /// generated thorax.
    double cell_m;
    /// Young's moduli above this are lowered to it, in Pa (an explicit step shrinks with the root of the
    /// modulus); 0 (default) for no cap. plp_model_info tells how many materials it met.
    double young_cap_pa;
    /// Told how far building is, and may cancel it. @nullable
    plp_progress_fn progress;
    /// Given to progress. @nullable
    void *progress_user;
    /// Told about the finished model, with warnings about materials that the cap lowered and about loose pieces of
    /// tissue: specks that are joined to nothing and held nowhere. These are kept, and move as free bodies. Not
    /// called after plp_model_create has returned. @nullable
    plp_log_fn log;
    /// Given to log. @nullable
    void *log_user;
    /// A closed mesh, PLP_SURFACE_MESH or PLP_SURFACE_FILE: cells of cell_m (which must be given) whose centres it winds around have label
    /// 1, those around it label 0, which is empty unless uses says otherwise. Triangles may face outwards or inwards, all of them alike; a shell
    /// in another that faces the other way is a cavity. A mesh with a hole is refused. It is no render surface by itself: name it among surfaces as
    /// well where it shall be one. @nullable
    const plp_surface_source *solid;
} plp_model_desc;

/// What a model turned out to be.
typedef struct {
    /// Nodes.
    uint64_t node_count;
    /// Occupied cells.
    uint64_t cell_count;
    /// Edge length of a cell in metres.
    double cell_m;
    /// The model frame: axes along the cells, origin at the grid's lowest corner.
    plp_pose frame;
    /// Lowest corner of the grid's bounding box, world axes, metres. Smoothed surfaces may reach half a cell
    /// beyond it.
    double bounds_min_m[3];
    /// Highest corner.
    double bounds_max_m[3];
    /// The cap on Young's modulus in Pa, 0 for none.
    double young_cap_pa;
    /// How many materials the cap lowered.
    uint32_t capped_material_count;
    /// Materials; in contacts, picks and surface views they are numbered from 1.
    uint32_t material_count;
    /// Surfaces; the desc's, and one more when contact needed one of its own.
    uint32_t surface_count;
    /// The surface that tools touch.
    uint32_t contact_surface;
    /// Cells of the bounding grid along x, y, z of the model frame.
    uint32_t cells[3];
    /// Always 0.
    uint32_t reserved;
} plp_model_info;

/// A GPU as its driver describes it.
typedef struct {
    /// Its name, UTF-8, ended by NUL.
    char name[128];
    /// Its memory in bytes, in use or not.
    uint64_t memory_bytes;
    /// Its compute capability, the number before the point.
    uint32_t capability_major;
    /// Its compute capability, the number behind the point.
    uint32_t capability_minor;
    /// 1 where simulations can run on it; 0 where its compute capability is too low.
    uint32_t is_supported;
    /// Always 0.
    uint32_t reserved;
} plp_device_info;

/// How a simulation runs. Fill it with plp_sim_desc_init (or plp_sim_desc_default), then change what you
/// need.
typedef struct {
    /// The size of this struct as the caller knows it.
    uint32_t struct_size;
    /// PLP_SIM_SLEEPING and so on, or'ed.
    uint32_t flags;
    /// Where it runs: PLP_BACKEND_CPU (default), PLP_BACKEND_CUDA or PLP_BACKEND_AUTO.
    uint32_t backend;
    /// CUDA: which GPU, from 0 to plp_device_count() - 1; -1 (default) takes the first that can. -1 for all others.
    int32_t device;
    /// PLP_PRECISION_SINGLE (default) or PLP_PRECISION_DOUBLE.
    uint32_t precision;
    /// Threads of the processor that compute a step, the calling one included; 0 (default) takes one for each core. Leave a
    /// core to a servo thread.
    uint32_t threads;
    /// Simulated length of a step in seconds (default 0.001).
    double step_s;
    /// Gravity in m/s^2, world frame (default 0).
    double gravity_m_s2[3];
    /// Background drag in 1/s (default 5): every node loses this part of its momentum each second.
    double drag_per_s;
    /// Substeps in a step; 0 (default) takes what the stable step asks for, and more when strain demands it. EFG: 0 is one.
    uint32_t substeps;
    /// Must be 0.
    uint32_t reserved;
    /// Told about the simulation, within the calls that cause it. @nullable
    plp_log_fn log;
    /// Given to log. @nullable
    void *log_user;
    /// What computes the tissue: PLP_METHOD_LATTICE (default) or PLP_METHOD_EFG.
    uint32_t method;
    /// EFG: how tissue answers to strain, PLP_ELASTICITY_COROTATED (default) and so on.
    uint32_t elasticity;
    /// EFG: how a step is taken, PLP_SCHEME_BACKWARD_EULER (default) or PLP_SCHEME_PAPER.
    uint32_t scheme;
    /// EFG: most iterations of a step (default 500); what was reached by then stands, and plp_statistics says so.
    uint32_t max_iterations;
    /// EFG: a step's solution is good enough when its true residual is this share of what it was before (default 0.001).
    double tolerance;
    /// Room for cuts: copies of nodes that they may make in all, some two for each cell that a blade passes; surfaces get room alike. 0 (default): tissue cannot be
    /// cut. A cut whose cells fall into more pieces than that is refused too.
    uint64_t cut_nodes;
    /// Parts that a cut severs, that nothing holds, and that are smaller than so many cells of the grid are removed with the cut, 0 to 1000; with 0 all stay. 1 (default) is what the grid resolves.
    /// plp_statistics.removed_kg counts them.
    double least_part_cells;
} plp_sim_desc;

/// A load that acts until it is removed. Fill it with plp_load_init (or plp_load_default), then set what its
/// kind needs.
typedef struct {
    /// The size of this struct as the caller knows it.
    uint32_t struct_size;
    /// PLP_LOAD_POINT, PLP_LOAD_TRACTION or PLP_LOAD_PRESSURE.
    uint32_t kind;
    /// POINT: the rest position in metres, inside the tissue, world frame.
    double at_m[3];
    /// POINT: the force in N, world frame.
    double force_n[3];
    /// TRACTION: force per area in Pa, world frame.
    double traction_pa[3];
    /// PRESSURE: in Pa; negative pulls.
    double pressure_pa;
    /// TRACTION, PRESSURE: the boundary faces whose rest centres lie in this box.
    plp_box region;
} plp_load;

/// What a ray met.
typedef struct {
    /// Where, world frame, metres.
    double point_m[3];
    /// Outward unit normal of the triangle there.
    double normal[3];
    /// Distance along the ray in metres.
    double distance_m;
    /// The triangle of the contact surface.
    uint32_t triangle;
    /// Material of the tissue, from 1.
    uint32_t material;
} plp_pick;

/// Where a simulation runs.
typedef struct {
    /// PLP_BACKEND_CPU or PLP_BACKEND_CUDA.
    uint32_t backend;
    /// The GPU's number, as for plp_device_get; -1 on the processor.
    int32_t device;
    /// The GPU's name; on the processor, how many threads compute. UTF-8, ended by NUL.
    char name[128];
    /// Why PLP_BACKEND_AUTO took the processor: a sentence in UTF-8, ended by NUL. Empty where it did not.
    char fallback[1024];
} plp_place;

/// A touched point of the tissue's surface.
typedef struct {
    /// Where, world frame, metres.
    double point_m[3];
    /// Unit normal of the tool there, pointing into the tissue.
    double normal[3];
    /// How deep the point would have been inside the tool without contact, in metres.
    double depth_m;
    /// Force on the tissue at this point in N.
    double force_n[3];
    /// Material of the tissue, from 1.
    uint32_t material;
    /// Always 0.
    uint32_t reserved;
} plp_contact;

/// Called on the simulation's own thread.
typedef void (*plp_thread_fn)(void *user);

/// How a simulation's own thread runs. Fill it with plp_thread_desc_init (or plp_thread_desc_default), then change what you need.
typedef struct {
    /// The size of this struct as the caller knows it.
    uint32_t struct_size;
    /// Must be 0.
    uint32_t reserved;
    /// The first thing on the thread: set its priority and affinity here. @nullable
    plp_thread_fn on_start;
    /// The last thing on it. @nullable
    plp_thread_fn on_stop;
    /// Given to both. @nullable
    void *user;
    /// How much lateness is made up for at most, in s (default 0.02); what is beyond is let go.
    double longest_lag_s;
} plp_thread_desc;

/// Something that happened while the simulation ran.
typedef struct {
    /// A PLP_EVENT_ value; later versions may have more.
    uint32_t kind;
    /// BUTTONS: all buttons now, a bit each.
    uint32_t buttons;
    /// Simulated time in s.
    double time_s;
    /// FELL_BEHIND: how much wall-clock time was let go since that was last told, half a second ago or longer, in s. SURFACE_BEHIND: the
    /// surface.
    double value;
    /// SERVO_SILENT, BUTTONS, CUT_REFUSED: plp_tool_get_id of the tool; 0 for all others.
    uint64_t tool_id;
} plp_event;

/// A shape of a tool. Sizes lie between 1e-5 m and 1 m.
typedef struct {
    /// PLP_SHAPE_SPHERE, PLP_SHAPE_CAPSULE or PLP_SHAPE_BOX.
    uint32_t kind;
    /// Must be 0.
    uint32_t reserved;
    /// The shape's place in the tool's frame.
    plp_pose pose;
    /// SPHERE, CAPSULE: the radius in metres. BOX: the radius of its edges, above 0 and at most the smallest
    /// half extent.
    double radius_m;
    /// CAPSULE: half the length of the swept segment in metres, caps not counted.
    double half_length_m;
    /// BOX: half the edge lengths in metres, rounding included.
    double half_extents_m[3];
} plp_tool_part;

/// How much tissue was removed.
typedef struct {
    /// Its volume at rest in m^3.
    double volume_m3;
    /// Its mass in kg.
    double mass_kg;
} plp_removed;

/// A part of the tissue that hangs together.
typedef struct {
    /// Its volume at rest in m^3.
    double volume_m3;
    /// Its mass in kg.
    double mass_kg;
    /// Velocity of its centre of mass in m/s, world frame.
    double velocity_m_s[3];
    /// 1 where nodes of it are held, along all axes; otherwise 0.
    uint32_t is_held;
    /// Names it for plp_sim_remove_part. A part that is cut further leaves its name to one of what it becomes.
    uint32_t id;
} plp_part;

/// How a simulation is doing.
typedef struct {
    /// Steps since creation.
    uint64_t steps;
    /// Substeps since creation.
    uint64_t substeps;
    /// Simulated time in seconds.
    double time_s;
    /// Length of the last substep in seconds.
    double substep_s;
    /// Largest stable substep at rest in seconds, damping included; infinite where steps are implicit.
    double stable_substep_s;
    /// Wall-clock time of the last step in seconds: from the call, waiting for a surface that is being mapped included, until
    /// the forces can be read. plp_sim_get_latency counts these times.
    double step_wall_s;
    /// How long the device was at work on the last step, in seconds: on a GPU by its own clock (which may tick but once in a
    /// microsecond), from the start of the first kernel until the report; on the processor wall-clock time. The rest of
    /// step_wall_s is spent on asking and answering.
    double step_device_s;
    /// Simulated time over wall-clock time of the last step: at least 1 keeps up with the world.
    double real_time_factor;
    /// All nodes.
    uint64_t node_count;
    /// Nodes integrated in the last substep.
    uint64_t awake_node_count;
    /// Bricks of 8 x 4 x 4 places for nodes that were integrated in the last substep.
    uint64_t awake_brick_count;
    /// Bytes held for the nodes' state and topology.
    uint64_t node_bytes;
    /// Largest |1 - L/l| of a spring along a cell's edge in the last substep, l being its length and L its rest length.
    double max_strain;
    /// Smallest volume ratio of a cell with a Poisson ratio above 1/4 in the last substep; 1 is undeformed, at most 0 is
    /// inside out.
    double min_volume_ratio;
    /// Largest volume ratio of such a cell in the last substep.
    double max_volume_ratio;
    /// Substeps in the last step.
    uint32_t substeps_per_step;
    /// Surface points in contact in the last substep.
    uint32_t contact_point_count;
    /// Surface points in tools since creation that were left out, because more were touched at once than there is room
    /// for. A force is then too small.
    uint64_t dropped_point_count;
    /// Bytes copied from the host to the GPU since creation, that included; 0 on the processor.
    uint64_t bytes_to_device;
    /// Bytes copied from the GPU to the host since creation, what it reports of each step included; 0 on the processor.
    uint64_t bytes_to_host;
    /// Steps of the simulation's own thread that ended after the next one was due.
    uint64_t overrun_count;
    /// Wall-clock time that this thread has let go because it fell too far behind, in seconds.
    double dropped_s;
    /// Events that found no room because nobody read them.
    uint64_t dropped_event_count;
    /// EFG: share of its first residual that the last step's solution left, computed from what was found.
    double true_residual;
    /// EFG: iterations of the last step's solution.
    uint32_t cg_iterations;
    /// 0.
    uint32_t reserved;
    /// Wall-clock time that cutting took in the last step, in seconds; part of step_wall_s.
    double cut_wall_s;
    /// Cells that cuts have divided.
    uint64_t divided_cell_count;
    /// Copies of nodes that cuts have made, of the room of plp_sim_desc.cut_nodes.
    uint64_t copy_count;
    /// Volume at rest of the tissue that was removed since the last reset, in m^3: what is left of the parts and this is what the model had.
    double removed_m3;
    /// Mass of that tissue in kg.
    double removed_kg;
} plp_statistics;

/// How long the steps of a simulation took, from the call until the forces could be read. Quantiles are the ends of buckets: up
/// to 19 % too long, never too short, and nothing longer than max_s. All are 0 before the first step.
typedef struct {
    /// Steps that were counted: those that ended well.
    uint64_t step_count;
    /// Half of all steps took no longer, in seconds.
    double p50_s;
    /// 99 of 100 took no longer.
    double p99_s;
    /// 999 of 1000 took no longer.
    double p999_s;
    /// The longest.
    double max_s;
    /// Steps that took less than a microsecond; for i from 1 to 80, at least 2^((i-1)/4) and less than 2^(i/4)
    /// microseconds; and, last, 2^20 microseconds or more.
    uint64_t counts[PLP_LATENCY_BUCKETS];
} plp_latency;

/// Energies in J, computed in double precision when asked for.
typedef struct {
    /// Kinetic energy.
    double kinetic_j;
    /// Elastic energy of springs and volume terms.
    double elastic_j;
    /// Potential energy under the gravity in force; balanced gravity counts as none.
    double gravity_j;
    /// Work that tools have done on the tissue since creation.
    double tool_work_j;
} plp_energy;

/// What a haptic device can bear, and how it holds its tool. Defaults are those of a 3D Systems Touch, the former Phantom Omni; fill it with
/// plp_haptic_desc_init (or plp_haptic_desc_default), then say what yours can.
typedef struct {
    /// The size of this struct as the caller knows it.
    uint32_t struct_size;
    /// PLP_HAPTIC_PASSIVE and so on, or'ed.
    uint32_t flags;
    /// Largest force in N.
    double max_force_n;
    /// Largest torque in N m; 0 for a device that renders none.
    double max_torque_n_m;
    /// Largest force that the motors bear for long, in N: a root mean square over window_s.
    double continuous_force_n;
    /// The same of the torque, in N m.
    double continuous_torque_n_m;
    /// Time over which these average, in s.
    double window_s;
    /// Largest stiffness that it renders stably, in N/m.
    double max_stiffness_n_m;
    /// And of rotation, in N m/rad.
    double max_stiffness_n_m_rad;
    /// Largest damping, in N s/m.
    double max_damping_n_s_m;
    /// And of rotation, in N m s/rad.
    double max_damping_n_m_s_rad;
    /// Fastest change of the force, in N/s; enough for the largest force to be gone in 30 ms.
    double slew_n_s;
    /// Fastest change of the torque, in N m/s.
    double slew_n_m_s;
    /// Rate of the servo loop in Hz, 200 or more.
    double servo_rate_hz;
    /// Fastest motion that is believed, in m/s.
    double max_speed_m_s;
    /// Where it can go, around its middle, in m.
    double workspace_m[3];
    /// PLP_COUPLING_VIRTUAL or PLP_COUPLING_DIRECT.
    uint32_t coupling;
    /// Must be 0.
    uint32_t reserved;
    /// VIRTUAL: stiffness of the spring in N/m; 0 (default) takes the device's largest.
    double coupling_n_m;
    /// VIRTUAL: its damping in N s/m (default 0).
    double coupling_n_s_m;
    /// VIRTUAL: torsional stiffness in N m/rad; 0 (default) takes the device's largest, where it renders torque.
    double coupling_n_m_rad;
    /// VIRTUAL: torsional damping in N m s/rad (default 0).
    double coupling_n_m_s_rad;
} plp_haptic_desc;

/// The cutting edge of a tool.
typedef struct {
    /// The points of a polyline, x, y, z in metres, tool frame [point_count * 3]. It cuts what it sweeps, in both directions.
    const double *edge_m;
    /// Number of points, 2 to 64.
    uint32_t point_count;
    /// Must be 0.
    uint32_t reserved;
    /// The toughness that tissue has for this edge, in J/m^2, which is N for each metre of edge: up to that force tissue sticks to the edge, then it is cut. 0 cuts
    /// freely. Measured values: 76 to 186 for a pig's liver, some 2000 for skin.
    double toughness_j_m2;
} plp_blade;

/// A tool: a rigid compound of shapes. Fill it with plp_tool_desc_init (or plp_tool_desc_default), then give
/// it parts.
typedef struct {
    /// The size of this struct as the caller knows it.
    uint32_t struct_size;
    /// Number of parts, 1 to 16; a blade may do without.
    uint32_t part_count;
    /// The shapes [part_count].
    const plp_tool_part *parts;
    /// Coulomb friction coefficient between tool and tissue, 0 to 100 (default 0).
    double friction;
    /// The haptic device that holds the tool, for plp_tool_exchange; NULL (default) where none does. @nullable
    const plp_haptic_desc *haptic;
    /// The edge that the tool cuts with; NULL (default) for one that presses alone. With a blade part_count may be 0. The simulation needs plp_sim_desc.cut_nodes. @nullable
    const plp_blade *blade;
} plp_tool_desc;

/// Where a tool is and how it moves.
typedef struct {
    /// The tool's pose.
    plp_pose pose;
    /// Velocity of the tool's origin in m/s, world frame. Contact takes the velocity from successive poses; this
    /// one and the next are kept with the force.
    double linear_m_s[3];
    /// Angular velocity in rad/s, world frame.
    double angular_rad_s[3];
} plp_motion;

/// What a tool feels: the tissue's reaction, averaged over the last step.
typedef struct {
    /// Force of the tissue on the tool in N, world frame.
    double force_n[3];
    /// Torque of the tissue on the tool about the tool's origin in N m, world frame.
    double torque_n_m[3];
    /// The motion that both were computed at.
    plp_motion motion;
    /// Simulated time at the end of that step in seconds.
    double time_s;
    /// Counts steps; 0 before the first one and after plp_sim_reset.
    uint64_t sequence;
} plp_force;

/// What a device says at a tick of its servo loop.
typedef struct {
    /// Where it is and how it moves, world frame.
    plp_motion motion;
    /// When that was, in seconds on a clock of yours that never runs backwards, from any start.
    double stamp_s;
    /// PLP_HAPTIC_RELEASED, or 0: also for a device without a dead-man switch.
    uint32_t flags;
    /// Its buttons, a bit each; changes come out as events.
    uint32_t buttons;
} plp_haptic_state;

/// What a servo loop gets at a tick.
typedef struct {
    /// Force for the device's motors in N, world frame: finite and within the device's limits, whatever happened.
    double force_n[3];
    /// Torque for its motors in N m, about the tool's origin, world frame.
    double torque_n_m[3];
    /// Where the tool is: the device's motion, or that of the proxy which hangs on it.
    plp_motion tool;
    /// Simulated time of the step that the force comes from, in s.
    double time_s;
    /// How long ago that step arrived, in s; negative before the first.
    double age_s;
    /// How old the pose was with which the newest force was computed when that arrived, in s.
    double latency_s;
    /// Counts steps, as in plp_force.
    uint64_t sequence;
    /// PLP_SERVO_, or'ed; 0 where the force is just what the tissue answers.
    uint32_t flags;
    /// Always 0.
    uint32_t reserved;
} plp_servo;

/// How a servo loop is doing.
typedef struct {
    /// Ticks so far.
    uint64_t tick_count;
    /// How many of them came after a pause, the first included.
    uint64_t pause_count;
    /// Energy that the hand has put into the loop, in J.
    double energy_j;
    /// The least it ever was: a passive loop stays at or above 0.
    double least_energy_j;
    /// Root of the mean square of the force, over the device's window, in N.
    double average_force_n;
    /// How long ago the newest step arrived, in s; negative before the first.
    double age_s;
    /// Time from a motion's stamp to the tick that saw the first force computed with it, in s: the newest, ...
    double latency_s;
    /// ... and the longest so far.
    double longest_latency_s;
} plp_servo_statistics;

/// One frame of a surface, world frame. The arrays belong to the library and are valid until
/// plp_surface_unmap; positions, normals and previous positions are aligned to 16 bytes. Vertex streams are
/// float, because renderers take float; poses and forces are double.
typedef struct {
    /// x, y, z in metres and 1 [vertex_count * 4].
    const float *positions;
    /// Unit normals and 0 [vertex_count * 4].
    const float *normals;
    /// The positions of the frame that this port mapped before, for motion vectors [vertex_count * 4].
    const float *previous_positions;
    /// The field chosen with plp_surface_set_field [vertex_count].
    const float *scalars;
    /// Texture coordinates u, v [vertex_count * 2].
    const float *uvs;
    /// Materials, from 1 [vertex_count].
    const uint8_t *materials;
    /// Vertex indices, counter-clockwise seen from outside [triangle_count * 3]. Once tissue is cut some triangles are 0, 0, 0: places for others to come.
    const uint32_t *triangles;
    /// Number of vertices.
    uint64_t vertex_count;
    /// Number of triangles.
    uint64_t triangle_count;
    /// Changes whenever anything but positions, normals and scalars does; 0 until the first cut.
    uint64_t topology_version;
    /// Simulated time of the frame in seconds.
    double time_s;
    /// The first of the triangles that cuts have laid open: all after it are. Their vertices are theirs alone, so that they can have a normal and a texture of their own; texture
    /// coordinates are lengths in metres there. triangle_count where nothing is cut.
    uint64_t first_wall_triangle;
} plp_surface_view;

/// The call did what was asked.
#define PLP_OK 0

/// The simulation (or its tool) behind a port is gone or failed; the call answered with the last known
/// values, forces with zero.
#define PLP_STOPPED 1

/// The call worked and found nothing; outputs are untouched.
#define PLP_NOTHING 2

/// The caller's array was shorter than the list; as much as fits was written.
#define PLP_TRUNCATED 3

/// A pointer that must not be NULL is NULL.
#define PLP_ERR_NULL -101

/// A handle of another kind, one that was destroyed, or no handle at all.
#define PLP_ERR_INVALID_HANDLE -102

/// A struct size that no version of this library knows; use the init function or sizeof.
#define PLP_ERR_STRUCT_SIZE -103

/// A value that the call cannot accept: not finite, out of range, unknown.
#define PLP_ERR_ARGUMENT -104

/// The call does not fit the handle's state, such as mapping a surface twice.
#define PLP_ERR_STATE -105

/// Another thread is inside a call on the same handle.
#define PLP_ERR_BUSY -106

/// Something that a newer header or a file may ask for, which this library does not do.
#define PLP_ERR_UNSUPPORTED -107

/// A file or buffer that does not follow its format, or promises more than it holds.
#define PLP_ERR_FORMAT -201

/// A file that cannot be opened or read.
#define PLP_ERR_IO -202

/// More than the library's stated limits: voxels, cells, materials, tools, memory.
#define PLP_ERR_LIMIT -203

/// The progress callback asked to stop.
#define PLP_ERR_CANCELLED -204

/// The simulation's state stopped being finite; it is frozen at its last good state. Reset it, or destroy it.
#define PLP_ERR_DIVERGED -301

/// No GPU that can be used, or no driver for it. The message says why.
#define PLP_ERR_NO_DEVICE -401

/// The GPU or its driver failed. A simulation that ran on it is lost and can only be destroyed; a new one may run
/// on the processor.
#define PLP_ERR_DEVICE -402

/// A defect of the library, contained. The message says where; please report it.
#define PLP_ERR_PANIC -901

/// An earlier call on this simulation answered PLP_ERR_PANIC; it can only be destroyed.
#define PLP_ERR_POISONED -902

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/// The interface version of the loaded library; plp_check_abi compares it with the header's.
///
/// @thread any
uint32_t plp_abi_version(void);

/// The library's version, such as "0.1.0". Static memory.
///
/// @thread any
const char *plp_version_string(void);

/// How the library was built, for reports: "kernels prebuilt", where the GPU's kernels came with the sources, or "kernels built
/// with nvcc". Static memory.
///
/// @thread any
const char *plp_build_string(void);

/// Whether the library can do something: 1 or 0. Known names are "lattice" (the lattice tissue model),
/// "double" (PLP_PRECISION_DOUBLE) and "cuda" (PLP_BACKEND_CUDA, where plp_device_count() finds a GPU); names that this version does
/// not know, and NULL, answer 0.
///
/// @thread any
int32_t plp_has(const char *feature);

/// The name of a status code, such as "PLP_ERR_BUSY"; "PLP_?" for a number that is none. Static memory.
///
/// @thread any
const char *plp_status_name(plp_status status);

/// What went wrong in the last failing call on this thread: a sentence in UTF-8, at most 1023 bytes, never
/// NULL, empty before the first failure. Valid until the next failing call on the same thread. Successful
/// calls leave it alone, and so do the @rt functions.
///
/// @thread any
const char *plp_last_error(void);

/// How many material presets there are.
///
/// @thread any
uint32_t plp_preset_count(void);

/// A preset by its number, from 0 to plp_preset_count() - 1. preset_size is sizeof(plp_preset).
///
/// @thread any
plp_status plp_preset_get(uint32_t index, plp_preset *preset, uint32_t preset_size);

/// A preset by its name, such as "lung" or "liver". preset_size is sizeof(plp_preset).
///
/// @thread any
plp_status plp_preset_find(const char *name, plp_preset *preset, uint32_t preset_size);

/// Fills a desc with defaults. desc_size is sizeof(plp_model_desc).
///
/// @thread any
plp_status plp_model_desc_init(plp_model_desc *desc, uint32_t desc_size);

/// Builds a model. Everything that the desc points to is copied; nothing is kept. May take seconds: the
/// desc's progress callback is told, and may cancel. The model is the caller's, to be given to
/// plp_model_destroy.
///
/// @thread any
plp_status plp_model_create(const plp_model_desc *desc, plp_model **model);

/// Writes a model to a file, which plp_model_load reads faster than plp_model_create builds. A file of that name is replaced. The file
/// depends on nothing but the model: it can be read on any machine, by a library of the same format version.
///
/// @thread any
plp_status plp_model_save(const plp_model *model,
                          const char *path);

/// Reads a model from a file that plp_model_save wrote. What simulations of it compute is the same to the last bit. Materials are as
/// they were simulated, so that plp_model_info.young_cap_pa is 0. A file that is damaged, or made to deceive, is refused with PLP_ERR_FORMAT. The model is
/// the caller's, to be given to plp_model_destroy.
///
/// @thread any
plp_status plp_model_load(const char *path,
                          plp_model **model);

/// Gives a model back. Simulations made from it keep what they need. NULL is fine.
///
/// @thread any
plp_status plp_model_destroy(plp_model *model);

/// What a model turned out to be. info_size is sizeof(plp_model_info).
///
/// @thread any
plp_status plp_model_get_info(const plp_model *model, plp_model_info *info, uint32_t info_size);

/// Material number `index` of a model, from 1 to plp_model_info.material_count, as it is simulated (after the
/// cap).
///
/// @thread any
plp_status plp_model_get_material(const plp_model *model, uint32_t index, plp_material *material);

/// How many NVIDIA GPUs there are. 0 where there is none, or no driver that works; plp_last_error() then says
/// why. The driver is looked for once in the life of a program, by the first call that needs it.
///
/// @thread any
uint32_t plp_device_count(void);

/// Describes a GPU by its number, from 0 to plp_device_count() - 1; nothing is taken up on it. Answers
/// PLP_ERR_NO_DEVICE where there is none at all. info_size is sizeof(plp_device_info).
///
/// @thread any
plp_status plp_device_get(uint32_t index, plp_device_info *info, uint32_t info_size);

/// Fills a desc with defaults. desc_size is sizeof(plp_sim_desc).
///
/// @thread any
plp_status plp_sim_desc_init(plp_sim_desc *desc, uint32_t desc_size);

/// Creates a simulation of a model, at rest at time 0. desc may be NULL for defaults (@nullable desc). The
/// simulation is the caller's, to be given to plp_sim_destroy; the model may be destroyed before it. On a GPU it may answer
/// PLP_ERR_NO_DEVICE, PLP_ERR_DEVICE, PLP_ERR_LIMIT (memory) or PLP_ERR_UNSUPPORTED (double precision).
///
/// @thread any
plp_status plp_sim_create(const plp_model *model,
                          const plp_sim_desc *desc,
                          plp_sim **sim);

/// Ends a simulation. Its tools and surfaces stay valid handles that answer PLP_STOPPED until they are
/// destroyed. NULL is fine.
///
/// @thread owner
plp_status plp_sim_destroy(plp_sim *sim);

/// Advances by one step of plp_sim_desc.step_s. Tools move to their newest poses over the step.
///
/// @thread owner
plp_status plp_sim_step(plp_sim *sim);

/// Lets the tissue come to rest under its loads, tools where they are, without simulated time passing. Stops
/// when no node accelerates by more than tolerance_m_s2, or after max_substeps. The largest acceleration left
/// goes to residual_m_s2 (@nullable residual_m_s2).
///
/// @thread owner
plp_status plp_sim_settle(plp_sim *sim, double tolerance_m_s2, uint64_t max_substeps, double *residual_m_s2);

/// Back to the rest state at time 0. Loads, tools and gravity stay.
///
/// @thread owner
plp_status plp_sim_reset(plp_sim *sim);

/// Changes gravity: three doubles in m/s^2, world frame.
///
/// @thread owner
plp_status plp_sim_set_gravity(plp_sim *sim, const double *gravity_m_s2);

/// Adds a load. Its id, never 0 and never used again in this simulation, goes to `id`.
///
/// @thread owner
plp_status plp_sim_add_load(plp_sim *sim, const plp_load *load, uint64_t *id);

/// Fills a load with defaults: none of any kind. load_size is sizeof(plp_load).
///
/// @thread any
plp_status plp_load_init(plp_load *load, uint32_t load_size);

/// Removes a load.
///
/// @thread owner
plp_status plp_sim_remove_load(plp_sim *sim, uint64_t id);

/// Moves the rigid region of a label: `motion` takes it, in the world frame, from its rest place to its new
/// one, which it reaches at the end of the next step.
///
/// @thread owner
plp_status plp_sim_drive_region(plp_sim *sim, uint32_t label, const plp_pose *motion);

/// The first triangle of the contact surface, as deformed now, that a ray meets. origin_m and direction are
/// three doubles each, world frame; direction need not be of unit length. Answers PLP_NOTHING where the ray
/// meets none.
///
/// @thread owner
plp_status plp_sim_pick(const plp_sim *sim, const double *origin_m, const double *direction, plp_pick *pick);

/// Where the simulation runs, and why not on a GPU. place_size is sizeof(plp_place).
///
/// @thread owner
plp_status plp_sim_get_place(const plp_sim *sim, plp_place *place, uint32_t place_size);

/// A quantity of all nodes (PLP_NODES_ value), three doubles each, always in the same order. Writes at most
/// `capacity` nodes to xyz and the number of all to node_count; answers PLP_TRUNCATED where capacity is less.
/// xyz may be NULL with a capacity of 0 (@nullable xyz).
///
/// @thread owner
plp_status plp_sim_get_nodes(const plp_sim *sim,
                             uint32_t field,
                             double *xyz,
                             uint64_t capacity,
                             uint64_t *node_count);

/// The contacts of a tool in the last substep. Writes at most `capacity` of them and the number of all to
/// contact_count; answers PLP_TRUNCATED where capacity is less. contacts may be NULL with a capacity of 0
/// (@nullable contacts). The tool's thread may be using it meanwhile.
///
/// @thread owner
plp_status plp_sim_get_contacts(const plp_sim *sim,
                                const plp_tool *tool,
                                plp_contact *contacts,
                                uint64_t capacity,
                                uint64_t *contact_count);

/// Fills a desc with defaults. desc_size is sizeof(plp_thread_desc).
///
/// @thread any
plp_status plp_thread_desc_init(plp_thread_desc *desc, uint32_t desc_size);

/// Has a thread of the simulation's own step at the wall clock's pace, one step in each plp_sim_desc.step_s, until plp_sim_stop or
/// plp_sim_destroy. plp_sim_step answers PLP_ERR_STATE meanwhile. All other calls work as before: those of the owner, and plp_surface_map, wait
/// for the step in progress; those of servo threads never wait. desc may be NULL for defaults (@nullable desc).
///
/// A simulation that fails on it pauses: its tools feel nothing, and plp_sim_poll_event says why. The log is told nothing from this thread.
///
/// @thread owner
plp_status plp_sim_start(plp_sim *sim,
                         const plp_thread_desc *desc);

/// Holds the simulation's own thread after the step in progress. Time that passes meanwhile is not made up for.
///
/// @thread owner
plp_status plp_sim_pause(plp_sim *sim);

/// Lets it go on.
///
/// @thread owner
plp_status plp_sim_resume(plp_sim *sim);

/// Ends the simulation's own thread, after the step in progress; from then on plp_sim_step steps. Fine where there is none.
///
/// @thread owner
plp_status plp_sim_stop(plp_sim *sim);

/// The oldest event that was not read yet, or PLP_NOTHING. At most 256 wait; plp_statistics.dropped_event_count counts those beyond. event_size
/// is sizeof(plp_event).
///
/// @thread owner
plp_status plp_sim_poll_event(plp_sim *sim,
                              plp_event *event,
                              uint32_t event_size);

/// Gives a material of the model, by its index from 1 (as in vertex streams and contacts), other properties, in this simulation alone and from the next
/// step on. Rigid materials stay rigid: PLP_ERR_ARGUMENT. The stable step follows at once, from a bound; it may be shorter than that of a model built so.
///
/// @thread owner
plp_status plp_sim_set_material(plp_sim *sim,
                                uint32_t material_index,
                                const plp_material *properties);

/// Holds the nodes whose rest positions lie in a box where they are now, along some axes, in this simulation alone. How many were not held so before goes to
/// node_count (@nullable node_count).
///
/// @thread owner
plp_status plp_sim_fix(plp_sim *sim,
                       const plp_fix *fix,
                       uint64_t *node_count);

/// Frees the nodes whose rest positions lie in a box along some axes, also what the model holds, but for rigid regions. How many were held goes to
/// node_count (@nullable node_count).
///
/// @thread owner
plp_status plp_sim_free(plp_sim *sim,
                        const plp_fix *fix,
                        uint64_t *node_count);

/// Has a tool hold the tissue's nodes that are within reach_m of it now and held by nothing else, besides those that it holds already: they go where it goes,
/// and it feels what that takes. How many it holds goes to node_count (@nullable node_count). The tool's
/// thread may be using it meanwhile; plp_sim_reset and plp_tool_destroy let go.
///
/// @thread owner
plp_status plp_sim_grasp(plp_sim *sim,
                         const plp_tool *tool,
                         double reach_m,
                         uint64_t *node_count);

/// Has a tool let go of what it holds. How many nodes that were goes to node_count (@nullable node_count).
///
/// @thread owner
plp_status plp_sim_release(plp_sim *sim, const plp_tool *tool, uint64_t *node_count);

/// Cuts what the edge of a blade sweeps on its straight way from one polyline to another, at once and without a tool: from_m and to_m are the edge's
/// points at the start and at the end, x, y, z in metres, world frame [point_count * 3]. Where it starts where the last such cut ended it sweeps on, and tissue that has moved against it meanwhile is
/// cut as well. Rigid tissue is not cut. How many cells were divided, or divided otherwise, goes to cell_count (@nullable cell_count).
///
/// Answers PLP_ERR_STATE where plp_sim_desc.cut_nodes is 0 and PLP_ERR_LIMIT where the room is spent: nothing is cut then. Tools with a blade cut by themselves.
///
/// @thread owner
plp_status plp_sim_cut(plp_sim *sim,
                       const double *from_m,
                       const double *to_m,
                       uint32_t point_count,
                       uint64_t *cell_count);

/// Removes the soft tissue in a shape, where it is now: the nodes in the shape, with all that lies between them and the shape's surface. The shape's pose is that in the world. The hole has walls as a cut has, and what stays
/// keeps its mass, place and velocity. How much that was goes to removed (@nullable removed): nothing where the shape holds no such node. Rigid tissue stays, with what is next to it, a thousandth of a cell. plp_sim_reset
/// brings all tissue back.
///
/// Answers PLP_ERR_STATE where plp_sim_desc.cut_nodes is 0 and PLP_ERR_LIMIT where the room is spent: nothing is removed then.
///
/// @thread owner
plp_status plp_sim_ablate(plp_sim *sim,
                          const plp_tool_part *shape,
                          plp_removed *removed);

/// Removes a part by its id, all of it, bone and held tissue too. How much that was goes to removed (@nullable removed).
///
/// Answers PLP_ERR_ARGUMENT where there is no part of that id, and PLP_ERR_STATE where plp_sim_desc.cut_nodes is 0.
///
/// @thread owner
plp_status plp_sim_remove_part(plp_sim *sim,
                               uint32_t id,
                               plp_removed *removed);

/// The parts that cuts have left, the largest first. Writes at most `capacity` of them and the number of all to part_count; answers PLP_TRUNCATED where capacity is less. parts may be
/// NULL with a capacity of 0 (@nullable parts).
///
/// @thread owner
plp_status plp_sim_get_parts(plp_sim *sim,
                             plp_part *parts,
                             uint64_t capacity,
                             uint64_t *part_count);

/// Keeps how a simulation is now, in the host's memory: tissue and how it moves, what cuts have made of it, materials, what is held, gravity, loads, where tools and rigid regions are, time and
/// statistics. Takes time and memory by the size of the model.
///
/// Answers PLP_ERR_DIVERGED for a simulation that has diverged.
///
/// @thread owner
plp_status plp_sim_snapshot(plp_sim *sim,
                            plp_snapshot **snapshot);

/// Makes all what it was at a snapshot of this simulation, or of another one of the same plp_model that was described alike; threads, gravity and which GPU it is may differ. From there the
/// simulation goes on as it did then: to the last bit, on a GPU of the same kind, for the same motions of its tools and drives of its regions. It goes on as well where it had diverged.
///
/// Tools and surfaces live on. A tool stands where it did and goes from there, in the next step, to where it was asked to be last; what it held it holds again. A tool that was not there then is put
/// in anew. In another simulation a tool is the one that was created in the same turn, loads counted too. Tools are without force until the next step, and devices feel nothing until they engage
/// anew. topology_version counts on where a surface changes. Loads have the ids of then.
///
/// Answers PLP_ERR_ARGUMENT for a snapshot of another model, or of a simulation that was described otherwise: nothing changes then. Where a GPU has too little memory left, PLP_ERR_LIMIT, steps
/// answer PLP_ERR_DIVERGED until plp_sim_reset or another restore. A snapshot serves any number of times.
///
/// @thread owner
plp_status plp_sim_restore(plp_sim *sim,
                           const plp_snapshot *snapshot);

/// Gives a snapshot back. It may outlive its simulation. NULL is fine.
///
/// @thread any
plp_status plp_snapshot_destroy(plp_snapshot *snapshot);

/// How the simulation is doing. statistics_size is sizeof(plp_statistics).
///
/// @thread owner
plp_status plp_sim_get_statistics(const plp_sim *sim, plp_statistics *statistics, uint32_t statistics_size);

/// How long the steps took since creation or plp_sim_reset_latency; plp_sim_reset leaves it alone. latency_size is
/// sizeof(plp_latency).
///
/// @thread owner
plp_status plp_sim_get_latency(const plp_sim *sim,
                               plp_latency *latency,
                               uint32_t latency_size);

/// Counts the times of steps from none on, as for a measurement that begins.
///
/// @thread owner
plp_status plp_sim_reset_latency(plp_sim *sim);

/// The energies now. Visits every spring: for tests and plots, not for every step. energy_size is
/// sizeof(plp_energy).
///
/// @thread owner
plp_status plp_sim_get_energy(const plp_sim *sim, plp_energy *energy, uint32_t energy_size);

/// Fills a desc with defaults: no parts yet, no friction. desc_size is sizeof(plp_tool_desc).
///
/// @thread any
plp_status plp_tool_desc_init(plp_tool_desc *desc, uint32_t desc_size);

/// Adds a tool to a simulation. It touches nothing until its first plp_tool_set_pose, which puts it there at
/// once: start outside the tissue, whose skin plp_sim_pick finds. The tool is the caller's, to be given to
/// plp_tool_destroy, before or after the simulation.
///
/// @thread owner
plp_status plp_tool_create(plp_sim *sim, const plp_tool_desc *desc, plp_tool **tool);

/// Takes a tool out of its simulation, from its next step on. NULL is fine.
///
/// @thread port
plp_status plp_tool_destroy(plp_tool *tool);

/// Says where the tool is and how it moves. The simulation moves it there over its next step. A motion that
/// is not finite, lies more than 10 km from the origin, or whose quaternion is not nearly unit, answers
/// PLP_ERR_ARGUMENT and leaves the tool where it was; a tool whose simulation is gone answers PLP_STOPPED.
///
/// @thread port @rt
plp_status plp_tool_set_pose(plp_tool *tool, const plp_motion *motion);

/// The newest force and torque on the tool. When the simulation is gone or failed it answers PLP_STOPPED, and
/// force and torque are zero, so that a device is let go even by a caller who ignores the status.
///
/// @thread port @rt
plp_status plp_tool_get_force(plp_tool *tool, plp_force *force);

/// One tick of the servo loop of a tool's haptic device: where the device is goes in, and the force for its motors comes out, followed from the newest
/// step to where the device is now and bounded by all that plp_haptic_desc says. Call it at the device's rate, whatever the simulation's; it does the work of
/// plp_tool_set_pose and plp_tool_get_force.
///
/// The force is there for every answer, also below 0: then and for a motion that is not valid it is going to zero or is zero. Answers PLP_STOPPED
/// when the simulation is gone or failed, PLP_ERR_STATE for a tool without plp_tool_desc.haptic, PLP_ERR_BUSY to the second of two threads. That one gets what
/// the tool answered last, with PLP_SERVO_HELD, for 10 ms by its own stamp_s, and no force after that, nor with PLP_HAPTIC_RELEASED or a motion that is none; as it has not been told of these, tell it again.
///
/// @thread port @rt
plp_status plp_tool_exchange(plp_tool *tool,
                             const plp_haptic_state *state,
                             plp_servo *servo);

/// How a tool's servo loop was doing at its last tick. Never enters the tool, so that it costs a servo nothing, whatever thread looks.
/// Answers PLP_ERR_STATE for a tool without plp_tool_desc.haptic. statistics_size is sizeof(plp_servo_statistics).
///
/// @thread any
plp_status plp_tool_get_servo_statistics(const plp_tool *tool,
                                         plp_servo_statistics *statistics,
                                         uint32_t statistics_size);

/// The id by which events name a tool: never 0 and never used again; 0 for what is no tool.
///
/// @thread any
uint64_t plp_tool_get_id(const plp_tool *tool);

/// Fills a desc with what a 3D Systems Touch bears. desc_size is sizeof(plp_haptic_desc).
///
/// @thread any
plp_status plp_haptic_desc_init(plp_haptic_desc *desc, uint32_t desc_size);

/// Opens a port on a surface of the simulation's model, `index` from 0 to plp_model_info.surface_count - 1.
/// Several ports on one surface are fine. The port is the caller's, to be given to plp_surface_destroy,
/// before or after the simulation.
///
/// @thread owner
plp_status plp_surface_create(plp_sim *sim, uint32_t index, plp_surface **surface);

/// Closes a port; a mapped view of it ends. NULL is fine.
///
/// @thread port
plp_status plp_surface_destroy(plp_surface *surface);

/// Chooses the scalar of later frames: PLP_FIELD_DISPLACEMENT (at first) or PLP_FIELD_STRAIN. Not while
/// mapped.
///
/// @thread port
plp_status plp_surface_set_field(plp_surface *surface, uint32_t field);

/// Takes the newest frame of the surface. Waits for a step or settling in progress; a step that comes
/// meanwhile waits until the arrays are filled, not until they are unmapped. The view's arrays are valid, and
/// do not change, until plp_surface_unmap. When the simulation, or its GPU, is gone it answers PLP_STOPPED with the last frame, or
/// PLP_ERR_STATE where there never was one. After a defect of the library it answers PLP_ERR_POISONED. view_size is sizeof(plp_surface_view).
///
/// @thread port
plp_status plp_surface_map(plp_surface *surface,
                           plp_surface_view *view,
                           uint32_t view_size);

/// Ends the view of plp_surface_map: its arrays must not be read any more.
///
/// @thread port
plp_status plp_surface_unmap(plp_surface *surface);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

/* ---- Helpers. They are compiled into your program and know the struct sizes of this header. ---- */

/// PLP_OK when the loaded library speaks this header's interface, PLP_ERR_UNSUPPORTED when it does not. Ask
/// first.
static inline plp_status plp_check_abi(void) {
    return plp_abi_version() == PLP_ABI_VERSION ? PLP_OK : PLP_ERR_UNSUPPORTED;
}

/// A model of the generated thorax, until you say otherwise.
static inline plp_model_desc plp_model_desc_default(void) {
    plp_model_desc desc;
    plp_model_desc_init(&desc, (uint32_t)sizeof desc);
    return desc;
}

/// Steps of 1 ms on all cores.
static inline plp_sim_desc plp_sim_desc_default(void) {
    plp_sim_desc desc;
    plp_sim_desc_init(&desc, (uint32_t)sizeof desc);
    return desc;
}

/// A tool without friction that still needs parts.
static inline plp_tool_desc plp_tool_desc_default(void) {
    plp_tool_desc desc;
    plp_tool_desc_init(&desc, (uint32_t)sizeof desc);
    return desc;
}

/// A 3D Systems Touch, until you say otherwise.
static inline plp_haptic_desc plp_haptic_desc_default(void) {
    plp_haptic_desc desc;
    plp_haptic_desc_init(&desc, (uint32_t)sizeof desc);
    return desc;
}

/// A thread without hooks.
static inline plp_thread_desc plp_thread_desc_default(void) {
    plp_thread_desc desc;
    plp_thread_desc_init(&desc, (uint32_t)sizeof desc);
    return desc;
}

/// No load yet.
static inline plp_load plp_load_default(void) {
    plp_load load;
    plp_load_init(&load, (uint32_t)sizeof load);
    return load;
}

/// A pose without rotation, in metres.
static inline plp_pose plp_pose_at(double x, double y, double z) {
    plp_pose pose = {{x, y, z}, {0.0, 0.0, 0.0, 1.0}};
    return pose;
}

/// A tool at rest, without rotation, in metres.
static inline plp_motion plp_motion_at(double x, double y, double z) {
    plp_motion motion = {{{x, y, z}, {0.0, 0.0, 0.0, 1.0}}, {0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
    return motion;
}

/// A ball at a tool's origin.
static inline plp_tool_part plp_sphere(double radius_m) {
    plp_pose centre = plp_pose_at(0.0, 0.0, 0.0);
    plp_tool_part part = {PLP_SHAPE_SPHERE, 0, centre, radius_m, 0.0, {0.0, 0.0, 0.0}};
    return part;
}

/// A capsule along z at a tool's origin.
static inline plp_tool_part plp_capsule(double radius_m, double half_length_m) {
    plp_tool_part part = plp_sphere(radius_m);
    part.kind = PLP_SHAPE_CAPSULE;
    part.half_length_m = half_length_m;
    return part;
}

/// A box at a tool's origin, its edges rounded by rounding_m.
static inline plp_tool_part plp_rounded_box(double half_x_m, double half_y_m, double half_z_m,
                                            double rounding_m) {
    plp_tool_part part = plp_sphere(rounding_m);
    part.kind = PLP_SHAPE_BOX;
    part.half_extents_m[0] = half_x_m;
    part.half_extents_m[1] = half_y_m;
    part.half_extents_m[2] = half_z_m;
    return part;
}

/// The use of a label as tissue (PLP_USE_TISSUE) or rigid region (PLP_USE_RIGID) of a preset material, or as
/// nothing (PLP_USE_EMPTY), where preset_name may be NULL. An unknown name leaves a material that
/// plp_model_create refuses.
static inline plp_label_use plp_label_as(uint32_t label, uint32_t kind, const char *preset_name) {
    plp_preset preset;
    plp_label_use use = {label, kind, {0.0, 0.0, 0.0, 0.0, {'?', 0}}};
    uint32_t i;
    if (kind == PLP_USE_EMPTY) {
        return use;
    }
    if (plp_preset_find(preset_name, &preset, (uint32_t)sizeof preset) == PLP_OK) {
        use.material = preset.material;
        return use;
    }
    for (i = 0; preset_name && preset_name[i] && i + 1 < (uint32_t)sizeof use.material.name; ++i) {
        use.material.name[i] = preset_name[i];
    }
    return use;
}

#endif  /* PALPATE_H */
