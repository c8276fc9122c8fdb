/* NVTX's library for tests: says on stdout when a range begins and ends, and in how many others it lies. */
#include <stdio.h>

static _Thread_local int depth;

int nvtxRangePushA(const char *name) {
    printf("nvtx: %d %s\n", depth, name);
    return depth++;
}
int nvtxRangePop(void) {
    printf("nvtx: %d\n", --depth);
    return depth;
}
