// A call that fails ends the program with what the library says.
#pragma once

#include <cstdio>
#include <cstdlib>

#include "palpate_hdapi.h"

inline void check(plp_status status) {
    if (status >= 0) return;
    std::fprintf(stderr, "%s: %s\n", plp_status_name(status), plp_last_error());
    std::exit(1);
}

/// The same for calls of the bridge.
inline void check_hd(plp_status status) {
    if (status >= 0) return;
    std::fprintf(stderr, "%s: %s\n", plp_status_name(status), plp_hd_last_error());
    std::exit(1);
}
