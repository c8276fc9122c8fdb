/* A haptic device feels tissue through plp_tool_exchange, stepped by hand and by the simulation's own thread; whatever goes wrong takes the force away, is
 * said, and hangs nobody. Nothing here asserts how long a thing takes, but that it comes. */
#define _POSIX_C_SOURCE 200809L
#include "check.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <time.h>

/* Where the ball touches the block, and how deep it is pressed. */
static double touches_z;
static const double DEPTH_M = 0.004;
/* More ticks than anything that must come may take. */
enum { MANY = 20000 };

static double now_s(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static double size_of(const plp_servo *servo) {
    const double *f = servo->force_n;
    return sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
}

/* A device on a line above the middle of the block, in time of its own. */
typedef struct {
    plp_tool *tool;
    double z, stamp_s;
    uint32_t flags;
    _Atomic uint32_t buttons; /* pressed by another thread */
    plp_servo felt;
} hand;

static plp_status tick(hand *h, double z) {
    plp_haptic_state state = {plp_motion_at(0.02, 0.02, z), h->stamp_s, h->flags, h->buttons};
    state.motion.linear_m_s[2] = (z - h->z) / 1e-3;
    h->z = z;
    h->stamp_s += 1e-3;
    return plp_tool_exchange(h->tool, &state, &h->felt);
}

/* Ticks and steps, a millisecond each, from where the hand is to `z`, at 50 mm/s, and then some. */
static void move(plp_sim *sim, hand *h, double z, int rest) {
    while (fabs(h->z - z) > 1e-9 || rest-- > 0) {
        const double way = fmax(-5e-5, fmin(5e-5, z - h->z));
        CHECK(tick(h, h->z + way) == PLP_OK);
        ANSWERS(PLP_OK, plp_sim_step(sim));
    }
}

static void by_hand(plp_sim *sim, hand *h) {
    plp_force force;
    plp_servo_statistics statistics;
    h->z = touches_z + 0.002;
    CHECK(tick(h, h->z) == PLP_OK);
    CHECK(h->felt.flags & PLP_SERVO_WAITING && size_of(&h->felt) == 0.0 && h->felt.age_s < 0.0);
    move(sim, h, h->z, 800); /* engages, and rises to its full share */
    CHECK(h->felt.flags == 0 && size_of(&h->felt) == 0.0 && h->felt.age_s >= 0.0);

    move(sim, h, touches_z - DEPTH_M, 1000);
    CHECK(plp_tool_get_force(h->tool, &force) == PLP_OK);
    CHECK(force.force_n[2] > 0.1);
    CHECK(fabs(h->felt.force_n[2] - force.force_n[2]) < 0.02 * force.force_n[2]); /* at rest the spring bears what the tissue does */
    CHECK(h->felt.tool.pose.position_m[2] > h->z); /* and the tool hangs back on it */
    const double pressed = size_of(&h->felt);
    ANSWERS(PLP_OK, plp_tool_get_servo_statistics(h->tool, &statistics, sizeof statistics));
    CHECK(statistics.tick_count > 1000 && statistics.pause_count == 1);
    CHECK(statistics.energy_j > 0.0 && statistics.least_energy_j > -1e-4);

    /* A position that is none: the force goes, and only a hand that comes from outside brings it back. */
    CHECK(tick(h, NAN) == PLP_OK && h->felt.flags & PLP_SERVO_NOT_FINITE);
    h->z = touches_z - DEPTH_M;
    for (int i = 0; i < 35; ++i) {
        CHECK(tick(h, h->z) == PLP_OK && isfinite(h->felt.force_n[2]));
        ANSWERS(PLP_OK, plp_sim_step(sim));
    }
    CHECK(size_of(&h->felt) == 0.0 && h->felt.flags & PLP_SERVO_WAITING);
    move(sim, h, touches_z + 0.002, 800);
    move(sim, h, touches_z - DEPTH_M, 1000);
    CHECK(fabs(size_of(&h->felt) - pressed) < 0.02 * pressed);

    /* A jump of 10 cm, and the dead-man switch, which alone may let the force step to nothing. */
    CHECK(tick(h, h->z + 0.1) == PLP_OK && h->felt.flags & PLP_SERVO_TOO_FAST);
    h->z = touches_z + 0.002;
    move(sim, h, h->z, 900);
    move(sim, h, touches_z - DEPTH_M, 1000);
    h->flags = PLP_HAPTIC_RELEASED;
    CHECK(tick(h, h->z) == PLP_OK && size_of(&h->felt) == 0.0 && h->felt.flags & PLP_SERVO_RELEASED);
    h->flags = 0;
    move(sim, h, touches_z + 0.002, 900);
}

/* A servo thread: it presses until it is told to stop. */
static hand shared;
static atomic_int done, pressing, stopped, silent, engaged;
static _Atomic double force_n;

static void *servo(void *unused) {
    (void)unused;
    const struct timespec pause = {0, 500000};
    double z = touches_z + 0.002;
    for (int i = 0; !atomic_load(&done); ++i) {
        const double goal = atomic_load(&pressing) ? touches_z - DEPTH_M : touches_z + 0.002;
        z += fmax(-2e-5, fmin(2e-5, goal - z));
        shared.stamp_s = now_s();
        const plp_status status = tick(&shared, z);
        CHECK(status == PLP_OK || status == PLP_STOPPED);
        CHECK(size_of(&shared.felt) <= 3.3);
        atomic_store(&stopped, status == PLP_STOPPED);
        atomic_store(&engaged, shared.felt.flags == 0);
        atomic_store(&force_n, size_of(&shared.felt));
        nanosleep(&pause, NULL);
        while (atomic_load(&silent)) nanosleep(&pause, NULL);
    }
    return NULL;
}

static void wait_for_force(int there) {
    const struct timespec pause = {0, 1000000};
    for (int i = 0; (atomic_load(&force_n) > 0.0) != there; ++i) {
        CHECK(i < MANY);
        nanosleep(&pause, NULL);
    }
}

/* Outside the tissue, until a force would count in full; then pressed. */
static void press_anew(void) {
    const struct timespec pause = {0, 1000000};
    atomic_store(&pressing, 0);
    for (int i = 0; !atomic_load(&engaged); ++i) {
        CHECK(i < MANY);
        nanosleep(&pause, NULL);
    }
    atomic_store(&pressing, 1);
    wait_for_force(1);
}

static plp_event wait_for(plp_sim *sim, uint32_t kind) {
    const struct timespec pause = {0, 1000000};
    plp_event event = {0, 0, 0.0, 0.0, 0};
    for (int i = 0; event.kind != kind; ++i) {
        CHECK(i < MANY);
        if (plp_sim_poll_event(sim, &event, sizeof event) == PLP_NOTHING) nanosleep(&pause, NULL);
    }
    return event;
}

static atomic_int started, ended;
static void on_start(void *user) { atomic_fetch_add((atomic_int *)user, 1); }
static void on_stop(void *user) { CHECK(user == &started); atomic_fetch_add(&ended, 1); }

static void by_thread(plp_sim *sim, pthread_t *thread) {
    plp_thread_desc how = plp_thread_desc_default();
    how.on_start = on_start;
    how.on_stop = on_stop;
    how.user = &started;
    ANSWERS(PLP_ERR_STATE, plp_sim_pause(sim));
    ANSWERS(PLP_OK, plp_sim_stop(sim)); /* there is none, and that is fine */
    ANSWERS(PLP_OK, plp_sim_start(sim, &how));
    ANSWERS(PLP_ERR_STATE, plp_sim_start(sim, &how));
    ANSWERS(PLP_ERR_STATE, plp_sim_step(sim));
    CHECK(pthread_create(thread, NULL, servo, NULL) == 0);
    press_anew();

    /* A simulation that stalls: the force is held, decays, and is gone; it comes back to a hand that comes from outside. */
    ANSWERS(PLP_OK, plp_sim_pause(sim));
    wait_for_force(0);
    ANSWERS(PLP_OK, plp_sim_resume(sim));
    press_anew();

    /* Buttons come out as events, and so does a servo that falls silent. */
    plp_event event;
    while (plp_sim_poll_event(sim, &event, sizeof event) == PLP_OK) {}
    shared.buttons = 5;
    event = wait_for(sim, PLP_EVENT_BUTTONS);
    CHECK(event.buttons == 5 && event.tool_id == plp_tool_get_id(shared.tool) && event.tool_id != 0);
    atomic_store(&silent, 1);
    CHECK(wait_for(sim, PLP_EVENT_SERVO_SILENT).tool_id == plp_tool_get_id(shared.tool));
    atomic_store(&silent, 0);

    /* The owner may ask while the thread steps, and step itself once it has ended. */
    plp_statistics statistics;
    plp_contact contacts[64];
    uint64_t count;
    ANSWERS(PLP_OK, plp_sim_get_statistics(sim, &statistics, sizeof statistics));
    CHECK(statistics.steps > 0 && statistics.dropped_event_count == 0);
    plp_status status = plp_sim_get_contacts(sim, shared.tool, contacts, 64, &count);
    CHECK(status == PLP_OK || status == PLP_TRUNCATED);
    ANSWERS(PLP_OK, plp_sim_stop(sim));
    CHECK(atomic_load(&started) == 1 && atomic_load(&ended) == 1);
    ANSWERS(PLP_OK, plp_sim_step(sim));
    ANSWERS(PLP_OK, plp_sim_start(sim, NULL));
    press_anew();
}

int main(void) {
    plp_model *model = block();
    plp_sim *sim = simulation(model);
    hand h = {held_ball(sim), 0.0, 0.0, 0, 0, {{0}, {0}, {{{0}, {0}}, {0}, {0}}, 0, 0, 0, 0, 0, 0}};
    plp_haptic_desc wrong = plp_haptic_desc_default();
    plp_tool_part part = plp_sphere(0.008);
    plp_tool_desc desc = plp_tool_desc_default();
    plp_tool *refused = NULL, *free_tool = ball(sim);
    plp_servo_statistics statistics;

    /* Devices that contradict themselves are refused with a sentence. */
    desc.parts = &part;
    desc.part_count = 1;
    desc.haptic = &wrong;
    wrong.slew_n_s = 1.0;
    ANSWERS(PLP_ERR_ARGUMENT, plp_tool_create(sim, &desc, &refused));
    wrong = plp_haptic_desc_default();
    wrong.coupling = 7;
    ANSWERS(PLP_ERR_ARGUMENT, plp_tool_create(sim, &desc, &refused));
    CHECK(refused == NULL);
    ANSWERS(PLP_ERR_STATE, plp_tool_get_servo_statistics(free_tool, &statistics, sizeof statistics));
    ANSWERS(PLP_OK, plp_tool_destroy(free_tool));
    CHECK(plp_tool_get_id(NULL) == 0 && plp_tool_get_id(h.tool) != 0);

    const double above[3] = {0.02, 0.02, 0.1}, down[3] = {0.0, 0.0, -1.0};
    plp_pick top;
    ANSWERS(PLP_OK, plp_sim_pick(sim, above, down, &top));
    touches_z = top.point_m[2] + 0.008;
    by_hand(sim, &h);

    /* A simulation that diverges lets go, whoever steps it, and says so. */
    plp_tool *wild = ball(sim);
    plp_status status = PLP_OK;
    for (int i = 0; i < 200 && status == PLP_OK; ++i) {
        plp_motion motion = plp_motion_at(0.02, 0.02, i % 2 ? 0.0 : 0.06);
        CHECK(plp_tool_set_pose(wild, &motion) == PLP_OK);
        status = plp_sim_step(sim);
    }
    CHECK(status == PLP_ERR_DIVERGED && wait_for(sim, PLP_EVENT_DIVERGED).time_s > 0.0);
    for (int i = 0; i < 35; ++i) CHECK(tick(&h, h.z) == PLP_STOPPED);
    CHECK(size_of(&h.felt) == 0.0);
    ANSWERS(PLP_OK, plp_tool_destroy(wild));
    ANSWERS(PLP_OK, plp_sim_reset(sim));

    pthread_t thread;
    shared = h;
    by_thread(sim, &thread);

    /* The simulation goes while the servo runs. */
    ANSWERS(PLP_OK, plp_sim_destroy(sim));
    /* No force may also mean that the hand was thrown off a moment before. */
    for (int i = 0; !atomic_load(&stopped); ++i) {
        const struct timespec pause = {0, 1000000};
        CHECK(i < MANY);
        nanosleep(&pause, NULL);
    }
    wait_for_force(0);
    atomic_store(&done, 1);
    CHECK(pthread_join(thread, NULL) == 0);
    ANSWERS(PLP_OK, plp_tool_destroy(h.tool));
    ANSWERS(PLP_OK, plp_model_destroy(model));
    puts("servo: ok");
    return 0;
}
