// One block of the engine by hand: 16 simulations in lockstep, contacts included. A ceiling for pourcast.
// The arithmetic of pourcast.engine (density, momentum, walls, integrator, contact), in C++ with the compiler's vector extensions and
// without all that makes the engine useful (batches, early ends, adhesion, frames).
// Usage: ceiling FILE STEPS. FILE: numbers as `benchmarks/ceiling.py` writes them.
// Prints the seconds that the steps took, and mean x and y at the end.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <vector>
#ifdef __AVX512F__
#include <immintrin.h>
#endif

constexpr int LANES = 16, SLOTS = 4, EDGES = 3, PASSES = 4;
constexpr float FAR = 1e6f, INF = std::numeric_limits<float>::infinity();
using V = float __attribute__((vector_size(64)));
using M = int __attribute__((vector_size(64)));

static inline V splat(float a) { return V{} + a; }
#ifdef __AVX512F__
static inline V larger(V a, V b) { return _mm512_max_ps(a, b); }
static inline V smaller(V a, V b) { return _mm512_min_ps(a, b); }
static inline V root(V a) { return _mm512_sqrt_ps(a); }
static inline bool any(M m) { return _mm512_test_epi32_mask((__m512i)m, (__m512i)m) != 0; }
#else
static inline V larger(V a, V b) { return a > b ? a : b; }
static inline V smaller(V a, V b) { return a < b ? a : b; }
static inline V root(V a) {
    V r;
    for (int k = 0; k < LANES; ++k) r[k] = std::sqrt(a[k]);
    return r;
}
static inline bool any(M m) {
    int r = 0;
    for (int k = 0; k < LANES; ++k) r |= m[k];
    return r != 0;
}
#endif

struct Edge { float x, y, nx, ny, length; };
using Polygon = std::vector<Edge>;
struct Near { V x, y, nx, ny, length; };

struct Block {
    int n;
    float width, depth, radius, support, rest, sound_speed, alpha, gravity, dt;
    std::vector<Polygon> polygons[LANES];
    std::vector<V> x, y, z, u, v, w, ax, ay, az, density, pressure, old_x, old_y;
    std::vector<V> listed_x, listed_y, slack, near_count;
    std::vector<Near> near;  // [particle][slot][edge]
    std::vector<int> most_near;

    void sum_densities() {
        const V zero{}, inverse = splat(1 / support);
        const auto shape = [](V t) { return t * t * t * t * (5.0f - 4.0f * t); };
        for (int i = 0; i < n; ++i) {
            V total = splat(1);
            for (V gap : {smaller(x[i], width - x[i]), y[i], smaller(z[i], depth - z[i])})
                total += shape(larger(1.0f - 2.0f * gap * inverse, zero));
            density[i] = total;
        }
        // Local pointers: members of `this` would be read again after every store.
        const V *X = x.data(), *Y = y.data(), *Z = z.data();
        V* __restrict D = density.data();
        for (int i = 0, count = n; i < count; ++i) {
            const V xi = X[i], yi = Y[i], zi = Z[i];
            V total = D[i];
            for (int j = 0; j < i; ++j) {
                const V dx = xi - X[j], dy = yi - Y[j], dz = zi - Z[j];
                const V share = shape(larger(1.0f - root(dx * dx + dy * dy + dz * dz) * inverse, zero));
                total += share;
                D[j] += share;
            }
            D[i] = total;
        }
    }

    V wall_push(V p, V below, V above, V inverse) {
        const V gap = smaller(below, above), t = larger(1.0f - 2.0f * gap * inverse, V{});
        const V size = 4.0f * p * gap * t * t * t;
        return above < below ? -size : size;
    }

    void sum_forces() {
        const float h = support / 2, gradient = 20 / (support * support * rest);
        const V zero{}, inverse = splat(1 / support), factor = splat(gradient * sound_speed * sound_speed);
        const V viscosity = splat(2 * gradient * alpha * sound_speed * h), least = splat(0.01f * h * h);
        for (int i = 0; i < n; ++i) {
            const V d = density[i] / rest, p = larger(d - 1.0f, zero) / (d * d);
            density[i] = d;
            pressure[i] = p;
            ax[i] = factor * wall_push(p, x[i], width - x[i], inverse);
            ay[i] = factor * wall_push(p, y[i], splat(INF), inverse);
            az[i] = factor * wall_push(p, z[i], depth - z[i], inverse);
        }
        const V *X = x.data(), *Y = y.data(), *Z = z.data(), *U = u.data(), *VV = v.data(), *W = w.data();
        const V *D = density.data(), *P = pressure.data();
        V *__restrict AX = ax.data(), *__restrict AY = ay.data(), *__restrict AZ = az.data();
        for (int i = 0, count = n; i < count; ++i) {
            const V xi = X[i], yi = Y[i], zi = Z[i], ui = U[i], vi = VV[i], wi = W[i], di = D[i], pi = P[i];
            V axi = AX[i], ayi = AY[i], azi = AZ[i];
            for (int j = 0; j < i; ++j) {
                const V dx = xi - X[j], dy = yi - Y[j], dz = zi - Z[j];
                const V r2 = dx * dx + dy * dy + dz * dz;
                const V approach = smaller((ui - U[j]) * dx + (vi - VV[j]) * dy + (wi - W[j]) * dz, zero);
                const V friction = approach / ((r2 + least) * (di + D[j]));
                const V t = larger(1.0f - root(r2) * inverse, zero);
                const V push = (factor * (pi + P[j]) - viscosity * friction) * (t * t * t);
                const V fx = push * dx, fy = push * dy, fz = push * dz;
                axi += fx;
                ayi += fy;
                azi += fz;
                AX[j] -= fx;
                AY[j] -= fy;
                AZ[j] -= fz;
            }
            AX[i] = axi;
            AY[i] = ayi;
            AZ[i] = azi;
        }
    }

    void move() {
        const V zero{}, low = splat(radius), right = splat(width - radius), back = splat(depth - radius);
        for (int i = 0; i < n; ++i) {
            old_x[i] = x[i];
            old_y[i] = y[i];
            u[i] += dt * ax[i];
            v[i] += dt * (ay[i] - gravity);
            w[i] += dt * az[i];
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
            float d[EDGES + 1] = {INF, INF, INF, INF};
            int nearest[EDGES + 1] = {};
            for (size_t k = 0; k < polygon.size(); ++k) {
                const Edge& e = polygon[k];
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
            for (int k = 0; k < EDGES; ++k) set_edge(i, count * EDGES + k, lane, polygon[nearest[k]]);
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
    Block b;
    b.n = number(file);
    for (float* value : {&b.width, &b.depth, &b.radius, &b.support, &b.rest, &b.sound_speed, &b.alpha,
                         &b.gravity, &b.dt})
        *value = number(file);
    for (auto* a : {&b.x, &b.y, &b.z, &b.u, &b.v, &b.w, &b.ax, &b.ay, &b.az, &b.density, &b.pressure,
                    &b.old_x, &b.old_y, &b.listed_x, &b.listed_y})
        a->assign(b.n, V{});
    b.slack.assign(b.n, splat(-1));
    b.near_count.assign(b.n, splat(SLOTS));
    b.near.resize(b.n * SLOTS * EDGES);
    b.most_near.assign(b.n, 0);
    for (int i = 0; i < b.n; ++i)
        for (auto* a : {&b.x, &b.y, &b.z}) (*a)[i] = splat(number(file));
    for (auto& lane : b.polygons) {
        lane.resize(number(file));
        for (Polygon& polygon : lane) {
            polygon.resize(number(file));
            for (Edge& e : polygon)
                for (float* value : {&e.x, &e.y, &e.nx, &e.ny, &e.length}) *value = number(file);
        }
    }
    const int steps = std::atoi(argv[2]);
    const auto start = std::chrono::steady_clock::now();
    for (int k = 0; k < steps; ++k) b.step();
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    double mean_x = 0, mean_y = 0;
    for (int i = 0; i < b.n; ++i)
        for (int lane = 0; lane < LANES; ++lane) {
            mean_x += b.x[i][lane] / (b.n * LANES);
            mean_y += b.y[i][lane] / (b.n * LANES);
        }
    std::printf("%.6f %.6f %.6f\n", seconds.count(), mean_x, mean_y);
}
