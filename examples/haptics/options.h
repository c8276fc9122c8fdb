// What the example can be told.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

struct Options {
    double seconds = 10.0;
    double scale = 1.0;             // world metres for each metre of the device
    double cell_m = 0.012;          // coarse and soft enough for two cores to step about in time
    double young_cap_pa = 20e3;
    double across = 0.5, up = 0.25; // where it presses, as shares of breadth and height
    unsigned threads = 0;           // of the simulation; 0 leaves one core to the servo
    bool is_virtual = false;        // emulator: virtual time, the same numbers each time
    bool is_hosted = false;         // a thread of this program steps, not one of the library
    bool is_direct = true;          // the tool is where the device is, and does not hang on a spring: README.md says why
    std::string labels, csv = "haptics.csv", motion = "press", device;
    std::vector<std::string> uses;  // LABEL=PRESET

    static constexpr const char *HELP =
        "haptics [--seconds 10] [--labels FILE LABEL=PRESET ...] [--cell MM] [--cap KPA] [--scale 1] [--threads N]\n"
        "        [--at 0.5,0.25] [--drive thread|host] [--coupling direct|virtual] [--csv haptics.csv] [--device NAME]\n"
        "        [--motion press|drag|tremor|random|FILE.csv] [--virtual]\n"
        "--motion and --virtual need the emulator; in virtual time this program steps.\n";

    /// False where they cannot be understood, which it says.
    bool parse(int argc, char **argv) {
        for (int i = 1; i < argc; ++i) {
            const std::string name = argv[i];
            if (name == "--virtual") {
                is_virtual = true;
            } else if (name.rfind("--", 0) != 0 && name.find('=') != std::string::npos) {
                uses.push_back(name);
            } else if (name.rfind("--", 0) != 0 || ++i == argc) {
                return refuse(name, "");
            } else if (const char *value = argv[i]; name == "--seconds") {
                if (!number(value, 1.0, &seconds) || seconds > 3600.0) return refuse(name, value);
            } else if (name == "--cell") {
                if (!number(value, 1e-3, &cell_m)) return refuse(name, value);
            } else if (name == "--cap") {
                if (!number(value, 1e3, &young_cap_pa)) return refuse(name, value);
            } else if (name == "--scale") {
                if (!number(value, 1.0, &scale)) return refuse(name, value);
            } else if (name == "--threads") {
                if (std::sscanf(value, "%u", &threads) != 1) return refuse(name, value);
            } else if (name == "--at") {
                if (std::sscanf(value, "%lf,%lf", &across, &up) != 2) return refuse(name, value);
            } else if (name == "--drive") {
                if (!choose(value, "thread", "host", &is_hosted)) return refuse(name, value);
            } else if (name == "--coupling") {
                if (!choose(value, "virtual", "direct", &is_direct)) return refuse(name, value);
            } else if (name == "--labels") {
                labels = value;
            } else if (name == "--csv") {
                csv = value;
            } else if (name == "--device") {
                device = value;
            } else if (name == "--motion") {
                motion = value;
            } else {
                return refuse(name, value);
            }
        }
        return labels.empty() == uses.empty() || refuse("--labels", "without LABEL=PRESET, or the other way round");
    }

private:
    static bool refuse(const std::string &name, const std::string &value) {
        std::fprintf(stderr, "haptics: %s %s is not understood\n", name.c_str(), value.c_str());
        return false;
    }

    // A number above 0, in units of `unit`.
    static bool number(const char *text, double unit, double *to) {
        char *end = nullptr;
        *to = unit * std::strtod(text, &end);
        return end != text && *end == '\0' && *to > 0.0 && *to < 1e9;
    }

    static bool choose(const std::string &value, const char *no, const char *yes, bool *is_yes) {
        *is_yes = value == yes;
        return *is_yes || value == no;
    }
};
