// Answers for the kernels' laws: with a law's name, reads the numbers that it takes, one set after another, and writes what it makes of each. Without a
// name, lists the laws.
#include "contact.cuh"
#include "efg.cuh"

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

// Laws that are templates compute in double precision.
template <typename T>
T wide(In& in) {
    static_assert(sizeof(T) % sizeof(double) == 0);
    double numbers[sizeof(T) / sizeof(double)];
    for (double& number : numbers) number = in.number();
    T value;
    memcpy(&value, numbers, sizeof value);
    return value;
}
Matrix<double> matrix(In& in) { return wide<Matrix<double>>(in); }
template <typename T>
void give_wide(const T& value) {
    double numbers[sizeof(T) / sizeof(double)];
    memcpy(numbers, &value, sizeof value);
    for (double number : numbers) give(float(number));
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
    {"float sliver_damping",
     [](In& in) {
         const float spring = in.number(), corner = in.number(), share = in.number();
         give(sliver_damping(spring, corner, share));
     }},
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
    {"float larger", [](In& in) { const float a = in.number(); give(larger(a, in.number())); }},
    {"double larger", [](In& in) { const double a = in.number(); give_wide(larger(a, double(in.number()))); }},
    {"float root", [](In& in) { give(root(in.number())); }},
    {"double root", [](In& in) { give_wide(root(double(in.number()))); }},
    {"Matrix<R> product", [](In& in) { const auto a = matrix(in); give_wide(product(a, matrix(in))); }},
    {"Matrix<R> transposed_product", [](In& in) { const auto a = matrix(in); give_wide(transposed_product(a, matrix(in))); }},
    {"Matrix<R> hooke", [](In& in) { const auto e = matrix(in); const double mu = in.number(); give_wide(hooke(e, mu, double(in.number()))); }},
    {"Matrix<R> stress_change",
     [](In& in) {
         const auto a = matrix(in), dg = matrix(in);
         const double mu = in.number();
         give_wide(stress_change(a, dg, mu, double(in.number())));
     }},
    {"Matrix<R> deformation", [](In& in) { give_wide(deformation(matrix(in))); }},
    {"Matrix<R> corotated_strain", [](In& in) { const auto r = matrix(in); give_wide(corotated_strain(r, matrix(in))); }},
    {"Matrix<R> corotated_stress",
     [](In& in) {
         const auto r = matrix(in), g = matrix(in);
         const double mu = in.number();
         give_wide(corotated_stress(r, g, mu, double(in.number())));
     }},
    {"Matrix<R> green_strain", [](In& in) { give_wide(green_strain(matrix(in))); }},
    {"Matrix<R> rotation_matrix", [](In& in) { give_wide(rotation_matrix(wide<Rotation<double>>(in))); }},
    {"Rotation<R> turn_towards", [](In& in) { const auto q = wide<Rotation<double>>(in); give_wide(turn_towards(q, matrix(in))); }},
    {"Gradient<R> gradient",
     [](In& in) {
         struct Corners { double u[3][8]; };
         const auto corners = wide<Corners>(in);
         give_wide(gradient(corners.u, double(in.number())));
     }},
    {"Answer<R> cell_answer",
     [](In& in) {
         const auto seen = wide<Gradient<double>>(in);
         const auto stress = matrix(in);
         const double hourglass = in.number();
         give_wide(cell_answer(seen, stress, hourglass, double(in.number())));
     }},
    {"Block<R> corner_block",
     [](In& in) {
         const auto a = matrix(in);
         const auto by = wide<Moduli<double>>(in);
         const double h = in.number(), sx = in.number(), sy = in.number();
         give_wide(corner_block(a, by, h, sx, sy, double(in.number())));
     }},
    {"Block<R> inverted", [](In& in) { give_wide(inverted(wide<Block<double>>(in))); }},
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
