// 16 simulations by hand, contacts included. A ceiling for pourcast: the fastest program known for this arithmetic.
// The arithmetic of pourcast.engine (density, momentum, walls, integrator, contact), in C++ with the compiler's vector extensions and
// without all that makes the engine useful (batches, early ends, adhesion, frames).
//
// LANES simulations run in lockstep, one a lane of the machine's vectors: 16 with AVX-512, 8 with AVX, 4 with NEON or SSE; then the next.
// Of the pairs, only those are looked at that are near in some lane; each takes one square root and one division a step; factors that all
// pairs share are taken out of the loops, which then need no more than the 16 registers of AVX2 (the i-particle's as memory operands).
//
// Usage: ceiling FILE STEPS. FILE: numbers as `benchmarks/ceiling.py` writes them.
// Prints the seconds of processor time that the steps took, and mean x and y at the end.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <limits>
#include <vector>
#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

#ifndef LANES
#if defined(__AVX512F__)
#define LANES 16
#elif defined(__AVX__)
#define LANES 8
#else
#define LANES 4
#endif
#endif

constexpr int SCENES = 16, SLOTS = 4, EDGES = 3, PASSES = 4;
constexpr float FAR = 1e6f, INF = std::numeric_limits<float>::infinity();
// A list of pairs holds until a particle has moved by half of this share of the support radius.
constexpr float SKIN = 0.1f;
using V = float __attribute__((vector_size(4 * LANES)));
using M = int __attribute__((vector_size(4 * LANES)));
#define INLINE inline __attribute__((always_inline))

static INLINE V splat(float a) { return V{} + a; }
#if LANES == 16
static INLINE V larger(V a, V b) { return _mm512_max_ps(a, b); }
static INLINE V smaller(V a, V b) { return _mm512_min_ps(a, b); }
static INLINE V root(V a) { return _mm512_sqrt_ps(a); }
static INLINE V fused(V a, V b, V c) { return _mm512_fmadd_ps(a, b, c); }
static INLINE bool any(M m) { return _mm512_test_epi32_mask((__m512i)m, (__m512i)m) != 0; }
#elif LANES == 8
static INLINE V larger(V a, V b) { return _mm256_max_ps(a, b); }
static INLINE V smaller(V a, V b) { return _mm256_min_ps(a, b); }
static INLINE V root(V a) { return _mm256_sqrt_ps(a); }
#ifdef __FMA__
static INLINE V fused(V a, V b, V c) { return _mm256_fmadd_ps(a, b, c); }
#else
static INLINE V fused(V a, V b, V c) { return a * b + c; }
#endif
static INLINE bool any(M m) { return _mm256_movemask_ps((__m256)m) != 0; }
#elif defined(__x86_64__)
static INLINE V larger(V a, V b) { return _mm_max_ps(a, b); }
static INLINE V smaller(V a, V b) { return _mm_min_ps(a, b); }
static INLINE V root(V a) { return _mm_sqrt_ps(a); }
static INLINE V fused(V a, V b, V c) { return a * b + c; }
static INLINE bool any(M m) { return _mm_movemask_ps((__m128)m) != 0; }
#elif defined(__aarch64__)
static INLINE V larger(V a, V b) { return (V)vmaxq_f32((float32x4_t)a, (float32x4_t)b); }
static INLINE V smaller(V a, V b) { return (V)vminq_f32((float32x4_t)a, (float32x4_t)b); }
static INLINE V root(V a) { return (V)vsqrtq_f32((float32x4_t)a); }
static INLINE V fused(V a, V b, V c) { return (V)vfmaq_f32((float32x4_t)c, (float32x4_t)a, (float32x4_t)b); }
static INLINE bool any(M m) { return vmaxvq_u32((uint32x4_t)m) != 0; }
#endif

// Take denormal numbers for 0, as the engine does: they are slow on some processors.
static void flush_denormals() {
#if defined(__x86_64__)
    _mm_setcsr(_mm_getcsr() | 0x8040);
#elif defined(__aarch64__)
    unsigned long mode;
    __asm__ volatile("mrs %0, fpcr" : "=r"(mode));
    __asm__ volatile("msr fpcr, %0" : : "r"(mode | 1ul << 24));
#endif
}

struct Edge { float x, y, nx, ny, length; };
struct Polygon { std::vector<Edge> edges; float x = 0, y = 0, radius = 0; };
struct Near { V x, y, nx, ny, length; };
struct Place { V x, y, z; };
// What pairs need of a particle, side by side: position over the support radius, density, velocity, pressure, acceleration.
struct Particle { V x, y, z, density, u, v, w, pressure, ax, ay, az; };

struct Block {
    int n;
    float width, depth, radius, support, rest, sound_speed, alpha, gravity, dt;
    std::vector<Polygon> polygons[LANES];
    std::vector<V> x, y, z, u, v, w, old_x, old_y;
    std::vector<Particle> particles;
    std::vector<Place> listed_at;
    std::vector<int> partners, first_pair;  // i's partners j < i: partners[first_pair[i]] up to first_pair[i + 1]
    std::vector<V> slopes;  // of each pair: (1 - r / support)^3, which density leaves to the forces
    std::vector<V> listed_x, listed_y, slack, near_count;
    std::vector<Near> near;  // [particle][slot][edge]
    std::vector<int> most_near;

    bool pairs_are_old() {
        V farthest{};
        for (int i = 0; i < n; ++i) {
            const Particle& a = particles[i];
            const V dx = a.x - listed_at[i].x, dy = a.y - listed_at[i].y, dz = a.z - listed_at[i].z;
            farthest = larger(farthest, dx * dx + dy * dy + dz * dz);
        }
        return any(farthest > SKIN * SKIN / 4);
    }

    void list_pairs() {
        int end = 0;
        for (int i = 0; i < n; ++i) {
            const Particle& a = particles[i];
            listed_at[i] = {a.x, a.y, a.z};
            first_pair[i] = end;
            for (int j = 0; j < i; ++j) {
                const Particle& b = particles[j];
                const V dx = a.x - b.x, dy = a.y - b.y, dz = a.z - b.z;
                partners[end] = j;
                end += any(dx * dx + dy * dy + dz * dz < (1 + SKIN) * (1 + SKIN));
            }
        }
        first_pair[n] = end;
    }

    // Arrays as local pointers: members of `this` would be read again after every store.
    static INLINE void add_density(Particle* __restrict all, int i, const int* partner, V* __restrict slope, int count) {
        const V x = all[i].x, y = all[i].y, z = all[i].z;
        V total = all[i].density;
        for (int k = 0; k < count; ++k) {
            Particle& b = all[partner[k]];
            const V dx = x - b.x, dy = y - b.y, dz = z - b.z;
            const V t = larger(1.0f - root(fused(dx, dx, fused(dy, dy, dz * dz))), V{});
            const V square = t * t, fourth = square * square, factor = fused(t, splat(-4), splat(5));
            slope[k] = square * t;
            total = fused(fourth, factor, total);
            b.density = fused(fourth, factor, b.density);
        }
        all[i].density = total;
    }

    void sum_densities() {
        const V zero{}, inverse = splat(1 / support);
        const auto shape = [](V t) { return t * t * t * t * (5.0f - 4.0f * t); };
        for (int i = 0; i < n; ++i) {
            Particle& a = particles[i];
            V total = splat(1);
            for (V gap : {smaller(x[i], width - x[i]), y[i], smaller(z[i], depth - z[i])})
                total += shape(larger(1.0f - 2.0f * gap * inverse, zero));
            a.x = x[i] * inverse;
            a.y = y[i] * inverse;
            a.z = z[i] * inverse;
            a.density = total;
        }
        if (pairs_are_old()) list_pairs();
        for (int i = 0; i < n; ++i) {
            const int first = first_pair[i];
            add_density(particles.data(), i, &partners[first], &slopes[first], first_pair[i + 1] - first);
        }
    }

    static INLINE V wall_push(V p, V below, V above, V inverse) {
        const V gap = smaller(below, above), t = larger(1.0f - 2.0f * gap * inverse, V{});
        const V size = 4.0f * p * gap * t * t * t;
        return above < below ? -size : size;
    }

    static INLINE void add_forces(Particle* __restrict all, int i, V floor, const int* partner, const V* __restrict slope, int count) {
        const Particle& a = all[i];
        const V x = a.x, y = a.y, z = a.z, u = a.u, v = a.v, w = a.w, density = a.density, pressure = a.pressure;
        V ax = a.ax, ay = a.ay, az = a.az;
        for (int k = 0; k < count; ++k) {
            Particle& b = all[partner[k]];
            const V dx = x - b.x, dy = y - b.y, dz = z - b.z;
            const V floored = fused(dx, dx, fused(dy, dy, fused(dz, dz, floor)));
            const V approach = smaller(fused(u - b.u, dx, fused(v - b.v, dy, (w - b.w) * dz)), V{});
            const V push = (pressure + b.pressure - approach / (floored * (density + b.density))) * slope[k];
            ax = fused(push, dx, ax);
            ay = fused(push, dy, ay);
            az = fused(push, dz, az);
            b.ax = fused(-push, dx, b.ax);
            b.ay = fused(-push, dy, b.ay);
            b.az = fused(-push, dz, b.az);
        }
        all[i].ax = ax;
        all[i].ay = ay;
        all[i].az = az;
    }

    void sum_forces() {
        const float h = support / 2, gradient = 20 / (support * support * rest);
        const float viscosity = 2 * gradient * alpha * sound_speed * h;
        const V zero{}, inverse = splat(1 / support), factor = splat(gradient * sound_speed * sound_speed);
        for (int i = 0; i < n; ++i) {
            Particle& a = particles[i];
            const V d = a.density * (1 / rest), p = larger(d - 1.0f, zero) / (d * d);
            a.u = u[i];
            a.v = v[i];
            a.w = w[i];
            a.ax = factor * wall_push(p, x[i], width - x[i], inverse);
            a.ay = factor * wall_push(p, y[i], splat(INF), inverse);
            a.az = factor * wall_push(p, z[i], depth - z[i], inverse);
            // Scaled so that the loop over pairs needs no factors.
            a.density = d * (1 / viscosity);
            a.pressure = p * (factor * support);
        }
        const V floor = splat(0.01f * h * h / (support * support));
        for (int i = 0; i < n; ++i) {
            const int first = first_pair[i];
            add_forces(particles.data(), i, floor, &partners[first], &slopes[first], first_pair[i + 1] - first);
        }
    }

    void move() {
        const V zero{}, low = splat(radius), right = splat(width - radius), back = splat(depth - radius);
        for (int i = 0; i < n; ++i) {
            old_x[i] = x[i];
            old_y[i] = y[i];
            u[i] += dt * particles[i].ax;
            v[i] += dt * (particles[i].ay - gravity);
            w[i] += dt * particles[i].az;
            x[i] += dt * u[i];
            y[i] += dt * v[i];
            z[i] += dt * w[i];
            u[i] = x[i] < low ? larger(u[i], zero) : (x[i] > right ? smaller(u[i], zero) : u[i]);
            v[i] = y[i] < low ? larger(v[i], zero) : v[i];
            w[i] = z[i] < low ? larger(w[i], zero) : (z[i] > back ? smaller(w[i], zero) : w[i]);
            x[i] = smaller(larger(x[i], low), right);
            y[i] = larger(y[i], low);
            z[i] = smaller(larger(z[i], low), back);
        }
    }

    void set_edge(int i, int place, int lane, const Edge& edge) {
        Near& to = near[i * SLOTS * EDGES + place];
        to.x[lane] = edge.x;
        to.y[lane] = edge.y;
        to.nx[lane] = edge.nx;
        to.ny[lane] = edge.ny;
        to.length[lane] = edge.length;
    }

    void list_near(int i, int lane) {
        const float px = x[i][lane], py = y[i][lane], touch = 1.1f * radius, skin = 0.5f * radius;
        float room = INF;
        int count = 0;
        for (const Polygon& polygon : polygons[lane]) {
            const float cx = px - polygon.x, cy = py - polygon.y, bound = std::sqrt(cx * cx + cy * cy) - polygon.radius;
            if (bound > touch + skin) {
                room = std::fmin(room, bound - touch);
                continue;
            }
            float d[EDGES + 1] = {INF, INF, INF, INF};
            int nearest[EDGES + 1] = {};
            for (size_t k = 0; k < polygon.edges.size(); ++k) {
                const Edge& e = polygon.edges[k];
                const float fx = px - e.x, fy = py - e.y, height = fx * e.nx + fy * e.ny;
                const float along = fy * e.nx - fx * e.ny;
                const float beyond = along - std::fmin(std::fmax(along, 0.0f), e.length);
                const float squared = height * height + beyond * beyond;
                int at = EDGES;
                if (squared >= d[at]) continue;
                for (; at > 0 && squared < d[at - 1]; --at) {
                    d[at] = d[at - 1];
                    nearest[at] = nearest[at - 1];
                }
                d[at] = squared;
                nearest[at] = k;
            }
            const float distance = std::sqrt(d[0]);
            if (distance > touch + skin) {
                room = std::fmin(room, distance - touch);
                continue;
            }
            if (count == SLOTS) continue;
            room = std::fmin(room, std::fmin(skin, 0.5f * (std::sqrt(d[EDGES]) - distance)));
            for (int k = 0; k < EDGES; ++k) set_edge(i, count * EDGES + k, lane, polygon.edges[nearest[k]]);
            ++count;
        }
        for (int slot = count; slot < near_count[i][lane]; ++slot)
            for (int k = 0; k < EDGES; ++k) set_edge(i, slot * EDGES + k, lane, {0, -FAR, 0, 1, 1});
        near_count[i][lane] = count;
        slack[i][lane] = room * room;
        listed_x[i][lane] = px;
        listed_y[i][lane] = py;
    }

    V gap(const Near* edges, V px, V py, V& nx, V& ny) {
        V nearest = splat(INF), highest = splat(-INF), gx{}, gy{};
        for (int k = 0; k < EDGES; ++k) {
            const Near& e = edges[k];
            const V fx = px - e.x, fy = py - e.y;
            const V along = smaller(larger(fy * e.nx - fx * e.ny, V{}), e.length);
            const V tx = fx + along * e.ny, ty = fy - along * e.nx, squared = tx * tx + ty * ty;
            gx = squared < nearest ? tx : gx;
            gy = squared < nearest ? ty : gy;
            nearest = smaller(squared, nearest);
            highest = larger(highest, fx * e.nx + fy * e.ny);
        }
        const V side = highest < 0.0f ? splat(-1) : splat(1), distance = root(nearest);
        const V scale = side / larger(distance, splat(1e-9f));
        nx = gx * scale;
        ny = gy * scale;
        return side * distance;
    }

    void collide(int i) {
        const V zero{}, one = splat(1);
        V px = x[i], py = y[i], pu = u[i], pv = v[i], nx, ny;
        const V from_wall = smaller(smaller(px, width - px), py);
        const V partners = near_count[i] + (from_wall < 1.5f * radius ? one : zero);
        const V several = partners > one ? one : zero;
        V active = one;
        const Near* edges = &near[i * SLOTS * EDGES];
        for (int pass = 0; pass < PASSES; ++pass) {
            V deepest{};
            for (int slot = 0; slot < most_near[i]; ++slot) {
                const V depth = larger(radius - gap(edges + slot * EDGES, px, py, nx, ny), zero) * active;
                deepest = larger(deepest, depth);
                px += depth * nx;
                py += depth * ny;
                const V out = pu * nx + pv * ny;
                const V change = (depth > zero ? larger(out, zero) : out) - out;
                pu += change * nx;
                pv += change * ny;
            }
            px = smaller(larger(px, splat(radius)), splat(width - radius));
            py = larger(py, splat(radius));
            active = (deepest > 1e-3f * radius ? several : zero) * active;
            if (!any(active > zero)) break;
        }
        if (any(active > zero)) {
            V clearance = splat(FAR);
            for (int slot = 0; slot < most_near[i]; ++slot)
                clearance = smaller(clearance, gap(edges + slot * EDGES, px, py, nx, ny));
            const M stuck = (clearance < 1e-4f) & (active > zero);
            px = stuck ? old_x[i] : px;
            py = stuck ? old_y[i] : py;
            pu = stuck ? zero : pu;
            pv = stuck ? zero : pv;
            w[i] = stuck ? zero : w[i];
        }
        x[i] = px;
        y[i] = py;
        u[i] = pu;
        v[i] = pv;
    }

    void step() {
        sum_densities();
        sum_forces();
        move();
        for (int i = 0; i < n; ++i) {
            const V dx = x[i] - listed_x[i], dy = y[i] - listed_y[i];
            const M old = dx * dx + dy * dy > slack[i];
            if (any(old)) {
                int most = 0;
                for (int lane = 0; lane < LANES; ++lane) {
                    if (old[lane]) list_near(i, lane);
                    most = std::max(most, static_cast<int>(near_count[i][lane]));
                }
                most_near[i] = most;
            }
            if (most_near[i] > 0) collide(i);
        }
    }
};

static double number(FILE* file) {
    double value;
    if (std::fscanf(file, "%lf", &value) != 1) std::exit(2);
    return value;
}

int main(int argc, char** argv) {
    FILE* file = argc == 3 ? std::fopen(argv[1], "r") : nullptr;
    if (!file) return 2;
    flush_denormals();
    Block b;
    b.n = number(file);
    for (float* value : {&b.width, &b.depth, &b.radius, &b.support, &b.rest, &b.sound_speed, &b.alpha,
                         &b.gravity, &b.dt})
        *value = number(file);
    for (auto* a : {&b.x, &b.y, &b.z, &b.u, &b.v, &b.w, &b.old_x, &b.old_y, &b.listed_x, &b.listed_y})
        a->assign(b.n, V{});
    b.particles.resize(b.n);
    b.listed_at.assign(b.n, {splat(FAR), splat(FAR), splat(FAR)});
    b.slopes.resize(b.n * (b.n - 1) / 2);
    b.partners.resize(b.slopes.size() + 1);  // one more, for a pair that turns out to be far
    b.first_pair.resize(b.n + 1);
    b.slack.assign(b.n, splat(-1));
    b.near_count.assign(b.n, splat(SLOTS));
    b.near.resize(b.n * SLOTS * EDGES);
    b.most_near.assign(b.n, 0);
    for (int i = 0; i < b.n; ++i)
        for (auto* a : {&b.x, &b.y, &b.z}) (*a)[i] = splat(number(file));
    std::vector<Polygon> scenes[SCENES];
    for (auto& scene : scenes) {
        scene.resize(number(file));
        for (Polygon& polygon : scene) {
            polygon.edges.resize(number(file));
            for (Edge& e : polygon.edges)
                for (float* value : {&e.x, &e.y, &e.nx, &e.ny, &e.length}) *value = number(file);
            for (const Edge& e : polygon.edges) {
                polygon.x += e.x / polygon.edges.size();
                polygon.y += e.y / polygon.edges.size();
            }
            for (const Edge& e : polygon.edges)
                polygon.radius = std::fmax(polygon.radius, std::hypot(e.x - polygon.x, e.y - polygon.y));
        }
    }
    const int steps = std::atoi(argv[2]);
    double seconds = 0, mean_x = 0, mean_y = 0;
    for (int first = 0; first < SCENES; first += LANES) {
        Block block = b;
        std::copy(scenes + first, scenes + first + LANES, block.polygons);
        const auto start = std::clock();
        for (int k = 0; k < steps; ++k) block.step();
        seconds += static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
        for (int i = 0; i < block.n; ++i)
            for (int lane = 0; lane < LANES; ++lane) {
                mean_x += block.x[i][lane] / (block.n * SCENES);
                mean_y += block.y[i][lane] / (block.n * SCENES);
            }
    }
    std::printf("%.6f %.6f %.6f\n", seconds, mean_x, mean_y);
}
