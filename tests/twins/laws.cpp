// Answers for the kernels' laws: with a law's name, reads the numbers that it takes, one set after another, and writes what it makes of each. Without a
// name, lists the laws.
#include "contact.cuh"

#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <vector>

// Numbers in their order.
struct In {
    const float* at;

    template <typename T>
    T take() {
        static_assert(sizeof(T) % sizeof(float) == 0);
        T value;
        memcpy(&value, at, sizeof value);
        at += sizeof value / sizeof(float);
        return value;
    }
    float number() { return take<float>(); }
    Vec vec() { return take<Vec>(); }
    Quat quat() { return take<Quat>(); }
};

template <typename T>
void give(const T& value) {
    fwrite(&value, sizeof value, 1, stdout);
}

struct Law {
    // What it returns, and its name.
    const char* name;
    void (*answer)(In& in);
};

constexpr int PARTS = 3;

// All as numbers.
void give_nearest(const Nearest& nearest) {
    give(nearest.distance);
    give(nearest.normal);
    give(float(nearest.part));
}

struct Tool {
    Part parts[PARTS];
};

// Arguments are taken one by one: those of a call are evaluated in any order.
const Law LAWS[] = {
    {"float elongation", [](In& in) { const float length2 = in.number(), rest = in.number(); give(elongation(length2, rest)); }},
    {"float minor",
     [](In& in) {
         const float a = in.number(), d = in.number(), b = in.number(), c = in.number();
         give(minor(a, d, b, c));
     }},
    {"float volume_change",
     [](In& in) {
         struct Gradient { float g[9]; };
         const Gradient gradient = in.take<Gradient>();
         float cof[9];
         const float change = volume_change(gradient.g, cof);
         give(cof);
         give(change);
     }},
    {"Vec operator+", [](In& in) { const Vec a = in.vec(), b = in.vec(); give(a + b); }},
    {"Vec operator-", [](In& in) { const Vec a = in.vec(), b = in.vec(); give(a - b); }},
    {"Vec operator*", [](In& in) { const Vec a = in.vec(); const float s = in.number(); give(a * s); }},
    {"float dot", [](In& in) { const Vec a = in.vec(), b = in.vec(); give(dot(a, b)); }},
    {"Vec cross", [](In& in) { const Vec a = in.vec(), b = in.vec(); give(cross(a, b)); }},
    {"float norm", [](In& in) { give(norm(in.vec())); }},
    {"float clamp", [](In& in) { const float x = in.number(), low = in.number(), high = in.number(); give(clamp(x, low, high)); }},
    {"Vec rotate", [](In& in) { const Quat q = in.quat(); const Vec v = in.vec(); give(rotate(q, v)); }},
    {"Quat conjugate", [](In& in) { give(conjugate(in.quat())); }},
    {"Quat operator*", [](In& in) { const Quat a = in.quat(), b = in.quat(); give(a * b); }},
    {"Quat turn_by", [](In& in) { give(turn_by(in.vec())); }},
    {"Distance from_core", [](In& in) { const Vec d = in.vec(); const float r = in.number(); give(from_core(d, r)); }},
    {"Distance shape_distance", [](In& in) { const Part part = in.take<Part>(); const Vec p = in.vec(); give(shape_distance(part, p)); }},
    {"Nearest tool_distance",
     [](In& in) { const Tool tool = in.take<Tool>(); const Vec p = in.vec(); give_nearest(tool_distance(tool.parts, PARTS, p)); }},
    {"int part_division", [](In& in) { const Part part = in.take<Part>(); give(float(part_division(part, in.number()))); }},
    {"unsigned tool_divisions",
     [](In& in) {
         const Tool tool = in.take<Tool>();
         const Vec p = in.vec();
         const float reach = in.number();
         give(tool_divisions(tool.parts, PARTS, p, reach, in.number()));
     }},
    {"Nearest meet",
     [](In& in) {
         const Tool tool = in.take<Tool>();
         const Vec start = in.vec(), end = in.vec();
         give_nearest(meet(tool.parts, PARTS, start, end, in.number()));
     }},
};

int main(int count, char** arguments) {
    if (count < 2) {
        for (const Law& law : LAWS) puts(law.name);
        return 0;
    }
    std::vector<float> numbers;
    float number;
    while (fread(&number, sizeof number, 1, stdin) == 1) numbers.push_back(number);
    for (const Law& law : LAWS) {
        if (strcmp(law.name, arguments[1]) != 0) continue;
        for (In in{numbers.data()}; in.at < numbers.data() + numbers.size();) law.answer(in);
        return 0;
    }
    fprintf(stderr, "there is no law \"%s\"\n", arguments[1]);
    return 1;
}
