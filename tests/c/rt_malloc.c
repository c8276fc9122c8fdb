/* Calls every @rt function from fresh threads while another thread steps, and fails on one allocation in them.
 *
 * The allocator is watched from outside, by replacing it, and the library is loaded while the program runs, as an
 * engine does it: the first touch of a thread-local variable of such a library allocates, which no allocator
 * inside the library would see. */
#define _GNU_SOURCE
#include "check.h"

#include <dlfcn.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>

extern void *__libc_malloc(size_t);
extern void *__libc_calloc(size_t, size_t);
extern void *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);
extern void __libc_free(void *);

/* In the program itself, so that touching them allocates nothing; volatile, because compilers believe that
 * malloc reads no variable of a program. */
static _Thread_local volatile int armed;
static atomic_int allocations, seen;

static void count(void) {
    atomic_fetch_add(&seen, 1);
    if (armed) {
        atomic_fetch_add(&allocations, 1);
    }
}
void *malloc(size_t size) { count(); return __libc_malloc(size); }
void *calloc(size_t n, size_t size) { count(); return __libc_calloc(n, size); }
void *realloc(void *old, size_t size) { count(); return __libc_realloc(old, size); }
void *aligned_alloc(size_t align, size_t size) { count(); return __libc_memalign(align, size); }
int posix_memalign(void **out, size_t align, size_t size) {
    count();
    *out = __libc_memalign(align, size);
    return *out ? 0 : 12;
}
void free(void *memory) { if (memory) count(); __libc_free(memory); }

static void *library;

static void *find(const char *name) {
    void *symbol = library ? dlsym(library, name) : NULL;
    if (!symbol) {
        fprintf(stderr, "%s: %s\n", name, library ? "not found" : "no library");
        exit(1);
    }
    return symbol;
}
#define FIND(name) find(#name)

/* The program is not linked with the library: what the header declares goes through the loaded one. */
#define FORWARD(type, name, parameters, arguments)                                                    \
    type name parameters {                                                                            \
        type(*function) parameters;                                                                   \
        *(void **)&function = FIND(name);                                                             \
        return function arguments;                                                                    \
    }
FORWARD(const char *, plp_last_error, (void), ())
FORWARD(const char *, plp_status_name, (plp_status status), (status))
FORWARD(plp_status, plp_model_desc_init, (plp_model_desc *desc, uint32_t size), (desc, size))
FORWARD(plp_status, plp_sim_desc_init, (plp_sim_desc *desc, uint32_t size), (desc, size))
FORWARD(plp_status, plp_tool_desc_init, (plp_tool_desc *desc, uint32_t size), (desc, size))
FORWARD(plp_status, plp_haptic_desc_init, (plp_haptic_desc *desc, uint32_t size), (desc, size))
FORWARD(plp_status, plp_model_create, (const plp_model_desc *desc, plp_model **out), (desc, out))
FORWARD(plp_status, plp_sim_create, (const plp_model *model, const plp_sim_desc *desc, plp_sim **out),
        (model, desc, out))
FORWARD(plp_status, plp_tool_create, (plp_sim *sim, const plp_tool_desc *desc, plp_tool **out),
        (sim, desc, out))
FORWARD(plp_status, plp_sim_step, (plp_sim *sim), (sim))

static plp_status (*set_pose)(plp_tool *, const plp_motion *);
static plp_status (*get_force)(plp_tool *, plp_force *);
static plp_status (*exchange)(plp_tool *, const plp_haptic_state *, plp_servo *);

static plp_tool *tool, *held;
static atomic_int done;

/* One life of a servo thread: every @rt function, with good and with bad arguments. */
static void *servo(void *unused) {
    plp_motion good = plp_motion_at(0.02, 0.02, 0.046), bad = good, far = good;
    plp_force force;
    plp_haptic_state hand = {good, 0.0, 0, 0}, lost = hand;
    plp_servo servo;
    int answers[11];
    (void)unused;
    bad.pose.rotation[3] = 0.0;
    far.pose.position_m[0] = 1e9;
    lost.motion.pose.position_m[1] = NAN;

    armed = 1;
    for (int i = 0; i < 2000; ++i) {
        good.pose.position_m[2] = 0.046 - 1e-6 * i;
        answers[0] = set_pose(tool, &good);
        answers[1] = get_force(tool, &force);
        answers[2] = set_pose(tool, &bad);
        answers[3] = set_pose(tool, NULL);
        answers[4] = set_pose(NULL, &good);
        answers[5] = get_force(tool, NULL);
        answers[6] = get_force(NULL, &force);
        answers[7] = set_pose(tool, &far);
        hand.motion = good;
        hand.stamp_s = lost.stamp_s = 1e-3 * i;
        answers[8] = exchange(held, i % 100 ? &hand : &lost, &servo);
        answers[9] = exchange(tool, &hand, &servo);
        answers[10] = exchange(held, NULL, &servo);
    }
    armed = 0;

    CHECK(answers[0] == PLP_OK && answers[1] == PLP_OK && answers[2] == PLP_ERR_ARGUMENT);
    CHECK(answers[7] == PLP_ERR_ARGUMENT);
    for (int i = 3; i < 7; ++i) {
        CHECK(answers[i] == PLP_ERR_NULL);
    }
    CHECK(answers[8] == PLP_OK && answers[9] == PLP_ERR_STATE && answers[10] == PLP_ERR_NULL);
    return NULL;
}

static void *servos(void *unused) {
    (void)unused;
    for (int i = 0; i < 20; ++i) {
        pthread_t thread;
        CHECK(pthread_create(&thread, NULL, servo, NULL) == 0 && pthread_join(thread, NULL) == 0);
    }
    atomic_store(&done, 1);
    return NULL;
}

int main(int argc, char **argv) {
    library = argc == 2 ? dlopen(argv[1], RTLD_NOW | RTLD_LOCAL) : NULL;
    if (!library) {
        fprintf(stderr, "%s\n", argc == 2 ? dlerror() : "usage: rt_malloc LIBRARY");
        return 1;
    }
    *(void **)&set_pose = FIND(plp_tool_set_pose);
    *(void **)&get_force = FIND(plp_tool_get_force);
    *(void **)&exchange = FIND(plp_tool_exchange);

    /* The counter counts. */
    int before = atomic_load(&allocations);
    armed = 1;
    void *volatile kept = malloc(8);
    free(kept);
    armed = 0;
    CHECK(atomic_load(&allocations) == before + 2);
    atomic_store(&allocations, 0);

    plp_model *model = block();
    plp_sim *sim = simulation(model);
    CHECK(atomic_load(&seen) > 100); /* and the library allocates through it */
    tool = ball(sim);
    held = held_ball(sim);
    pthread_t thread;
    CHECK(pthread_create(&thread, NULL, servos, NULL) == 0);
    do {
        ANSWERS(PLP_OK, plp_sim_step(sim));
    } while (!atomic_load(&done));
    CHECK(pthread_join(thread, NULL) == 0);

    CHECK(atomic_load(&allocations) == 0);
    puts("real-time calls allocate nothing: ok");
    return 0;
}
