/* A CUDA driver for tests: GPUs (1 where GPUS says nothing else) with the host's memory, whose kernels compute nothing, but
 * that every step is reported.
 *
 * FAKE_FAULT="NAME STATUS GOOD" makes the function NAME answer STATUS after GOOD good calls. As with a real driver, a lost
 * device (700 and above) stays lost but can be asked for its name, and a stub (34) can do nothing at all. The name "report" stands for no function: steps
 * after GOOD good ones end without a report.
 *
 * What the program takes from it and has not given back in the end is counted on stderr. When a context is given back, stdout is told
 * the bytes that went to the device since it was taken, and those that came from it, reports included.
 */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef GPUS
#define GPUS 1
#endif
#ifndef MAJOR
#define MAJOR 9
#endif

typedef uint64_t address;

/* Twins of Step and Report in src/cuda/layout.rs, as far as they are used here. */
typedef struct {
    float dt, keep, gravity[3];
    uint32_t sequence, tool_count;
} step_start;
typedef struct {
    uint32_t diverged_at;
    float measures[4];
    uint32_t awake[3];
    double vis_viva;
    uint32_t counts[3];
    float residual;
    uint32_t points;
    uint64_t device_ns;
    double sums[64][7];
    uint32_t sequence;
} step_report;

/* A recorded step: its one copy, and where its report goes. */
typedef struct {
    void *to;
    const void *from;
    size_t bytes;
    const step_start *step;
    step_report *report;
} graph;

static graph *recorded, *pending;
static char report_kernel, other_kernel, context, stream, module;
static int stuck, held;
static size_t bytes_to_device, bytes_to_host;

__attribute__((destructor)) static void count_held(void) {
    if (held) fprintf(stderr, "%d things of the driver's were not given back\n", held);
}

static int status_of(const char *function) {
    static int calls;
    char name[64];
    int status, good;
    const char *fault = getenv("FAKE_FAULT");
    if (stuck && (stuck == 34 || strncmp(function, "cuDevice", 8))) return stuck;
    if (!fault || sscanf(fault, "%63s %d %d", name, &status, &good) != 3 || strcmp(name, function) || calls++ < good) {
        return 0;
    }
    if (status == 34 || status >= 700) stuck = status;
    return status;
}

/* Opens a function: it fails when it is its turn. */
#define TRY                                                                                           \
    do {                                                                                              \
        int status = status_of(__func__);                                                             \
        if (status) return status;                                                                    \
    } while (0)

static void *at(address a) { return (void *)(uintptr_t)a; }

static int taken(void) { ++held; return 0; }
static int given_back(void) { --held; return stuck; }

/* Work is done when somebody asks whether it is. */
static void work(void) {
    if (!pending) return;
    graph *step = pending;
    pending = NULL;
    memcpy(step->to, step->from, step->bytes);
    bytes_to_device += step->bytes;
    if (status_of("report")) return;
    bytes_to_host += offsetof(step_report, sums[step->step->tool_count]) + sizeof step->report->sequence;
    step->report->diverged_at = UINT32_MAX;
    step->report->device_ns = 250000;
    step->report->sequence = step->step->sequence;
}

int cuInit(unsigned flags) { TRY; return (int)flags; }
int cuDriverGetVersion(int *version) { TRY; *version = 13000; return 0; }
int cuGetErrorName(int status, const char **name) {
    static const struct { int status; const char *name; } names[] = {
        {2, "CUDA_ERROR_OUT_OF_MEMORY"},     {100, "CUDA_ERROR_NO_DEVICE"}, {700, "CUDA_ERROR_ILLEGAL_ADDRESS"},
        {719, "CUDA_ERROR_LAUNCH_FAILED"},   {999, "CUDA_ERROR_UNKNOWN"},
    };
    if (stuck == 34) return 34;
    for (size_t i = 0; i < sizeof names / sizeof *names; ++i) {
        if (names[i].status == status) {
            *name = names[i].name;
            return 0;
        }
    }
    return 1;
}

int cuDeviceGetCount(int *count) { TRY; *count = GPUS; return 0; }
int cuDeviceGet(int *device, int index) { TRY; *device = index; return 0; }
int cuDeviceGetName(char *name, int length, int device) {
    TRY;
    snprintf(name, (size_t)length, "Fake %d", device);
    return 0;
}
int cuDeviceGetAttribute(int *value, int attribute, int device) {
    TRY;
    (void)device;
    *value = attribute == 75 ? MAJOR : attribute == 76 ? 0 : 227 << 10;
    return 0;
}
int cuDeviceTotalMem_v2(size_t *bytes, int device) { TRY; (void)device; *bytes = (size_t)8 << 30; return 0; }

int cuDevicePrimaryCtxRetain(void **retained, int device) {
    TRY;
    (void)device;
    *retained = &context;
    bytes_to_device = bytes_to_host = 0;
    return taken();
}
int cuDevicePrimaryCtxRelease_v2(int device) {
    (void)device;
    printf("driver: %zu bytes to the device, %zu to the host\n", bytes_to_device, bytes_to_host);
    return given_back();
}
int cuCtxPushCurrent_v2(void *pushed) { return pushed == &context ? 0 : 1; }
int cuCtxPopCurrent_v2(void **popped) { *popped = &context; return 0; }

int cuStreamCreate(void **made, unsigned flags) { TRY; (void)flags; *made = &stream; return taken(); }
int cuStreamDestroy_v2(void *s) { (void)s; return given_back(); }
int cuStreamSynchronize(void *s) { TRY; (void)s; work(); return stuck; }
#ifndef WITHOUT_STREAM_QUERY
int cuStreamQuery(void *s) { TRY; (void)s; work(); return stuck; }
#endif
int cuStreamBeginCapture_v2(void *s, unsigned mode) {
    TRY;
    (void)s, (void)mode;
    recorded = calloc(1, sizeof *recorded);
    return 0;
}
int cuStreamEndCapture(void *s, void **ended) { TRY; (void)s; *ended = recorded; recorded = NULL; return 0; }
int cuGraphInstantiateWithFlags(void **made, void *of, uint64_t flags) { TRY; (void)flags; *made = of; return taken(); }
int cuGraphLaunch(void *launched, void *s) { TRY; (void)s; pending = launched; return 0; }
int cuGraphExecDestroy(void *gone) { if (pending == gone) pending = NULL; free(gone); return given_back(); }
int cuGraphDestroy(void *gone) { (void)gone; return stuck; }

int cuMemAlloc_v2(address *got, size_t bytes) { TRY; *got = (uintptr_t)malloc(bytes); return taken(); }
int cuMemFree_v2(address a) { free(at(a)); return given_back(); }
int cuMemHostAlloc(void **got, size_t bytes, unsigned flags) { TRY; (void)flags; *got = malloc(bytes); return taken(); }
int cuMemFreeHost(void *a) { free(a); return given_back(); }
int cuMemHostGetDevicePointer_v2(address *got, void *a, unsigned flags) { TRY; (void)flags; *got = (uintptr_t)a; return 0; }
int cuMemcpyHtoDAsync_v2(address to, const void *from, size_t bytes, void *s) {
    TRY;
    (void)s;
    if (recorded) {
        recorded->to = at(to), recorded->from = from, recorded->bytes = bytes;
    } else {
        memcpy(at(to), from, bytes);
        bytes_to_device += bytes;
    }
    return 0;
}
int cuMemcpyDtoHAsync_v2(void *to, address from, size_t bytes, void *s) {
    TRY;
    (void)s;
    memcpy(to, at(from), bytes);
    bytes_to_host += bytes;
    return 0;
}
int cuMemsetD32Async(address to, unsigned word, size_t words, void *s) {
    TRY;
    (void)s;
    for (size_t i = 0; i < words; ++i) ((uint32_t *)at(to))[i] = word;
    return 0;
}

int cuModuleLoadData(void **made, const void *image) { TRY; (void)image; *made = &module; return taken(); }
int cuModuleUnload(void *gone) { (void)gone; return given_back(); }
int cuModuleGetFunction(void **found, void *in, const char *name) {
    TRY;
    (void)in;
    *found = strcmp(name, "report") ? &other_kernel : &report_kernel;
    return 0;
}
int cuFuncGetAttribute(int *value, int attribute, void *f) { TRY; (void)f, (void)attribute; *value = 75; return 0; }
int cuFuncSetAttribute(void *f, int attribute, int value) { TRY; (void)f, (void)attribute, (void)value; return 0; }
int cuLaunchKernelEx(const void *config, void *kernel, void **arguments, void **extra) {
    TRY;
    (void)config, (void)extra;
    if (kernel == &report_kernel) {
        recorded->step = at(*(const address *)arguments[2]);
        recorded->report = at(*(const address *)arguments[10]);
    }
    return 0;
}
