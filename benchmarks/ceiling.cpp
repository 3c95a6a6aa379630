// The force loops of pourcast.engine.sph by hand, with AVX-512 intrinsics: a ceiling for the engine.
// Density and forces over all pairs of 16 simulations in lockstep; no contacts, no integration.
// Usage: ceiling N STEPS; prints the seconds that the steps took.
#include <immintrin.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

using V = __m512;

int main(int argc, char** argv) {
    const int n = std::atoi(argv[1]), steps = std::atoi(argv[2]);
    std::vector<float> memory(11 * 16 * n + 16);
    float* base = memory.data() + (64 - reinterpret_cast<size_t>(memory.data()) % 64) / 4 % 16;
    float *x = base, *y = x + 16 * n, *z = y + 16 * n, *u = z + 16 * n, *v = u + 16 * n, *w = v + 16 * n;
    float *ax = w + 16 * n, *ay = ax + 16 * n, *az = ay + 16 * n, *d = az + 16 * n, *p = d + 16 * n;
    std::srand(1);
    for (int k = 0; k < 6 * 16 * n; ++k) base[k] = 0.15f * std::rand() / RAND_MAX;
    const V zero = _mm512_setzero_ps(), one = _mm512_set1_ps(1.0f);
    const V four = _mm512_set1_ps(4.0f), five = _mm512_set1_ps(5.0f);
    const V inverse = _mm512_set1_ps(1.0f / 0.085f), floor_ = _mm512_set1_ps(1.8e-5f);
    const V factor = _mm512_set1_ps(1.0f), viscosity = _mm512_set1_ps(0.01f);
    const auto start = std::chrono::steady_clock::now();
    for (int step = 0; step < steps; ++step) {
        for (int i = 0; i < n; ++i) _mm512_store_ps(d + 16 * i, one);
        for (int i = 0; i < n; ++i) {
            const V xi = _mm512_load_ps(x + 16 * i), yi = _mm512_load_ps(y + 16 * i);
            const V zi = _mm512_load_ps(z + 16 * i);
            V total = _mm512_load_ps(d + 16 * i);
            for (int j = 0; j < i; ++j) {
                const V dx = _mm512_sub_ps(xi, _mm512_load_ps(x + 16 * j));
                const V dy = _mm512_sub_ps(yi, _mm512_load_ps(y + 16 * j));
                const V dz = _mm512_sub_ps(zi, _mm512_load_ps(z + 16 * j));
                const V r2 = _mm512_fmadd_ps(dx, dx, _mm512_fmadd_ps(dy, dy, _mm512_mul_ps(dz, dz)));
                const V t = _mm512_max_ps(_mm512_fnmadd_ps(_mm512_sqrt_ps(r2), inverse, one), zero);
                const V t2 = _mm512_mul_ps(t, t);
                const V share = _mm512_mul_ps(_mm512_mul_ps(t2, t2), _mm512_fnmadd_ps(four, t, five));
                total = _mm512_add_ps(total, share);
                _mm512_store_ps(d + 16 * j, _mm512_add_ps(_mm512_load_ps(d + 16 * j), share));
            }
            _mm512_store_ps(d + 16 * i, total);
        }
        for (int i = 0; i < n; ++i) {
            const V density = _mm512_load_ps(d + 16 * i);
            const V over = _mm512_max_ps(_mm512_sub_ps(density, four), zero);
            _mm512_store_ps(p + 16 * i, _mm512_div_ps(over, _mm512_mul_ps(density, density)));
            for (float* a : {ax, ay, az}) _mm512_store_ps(a + 16 * i, zero);
        }
        for (int i = 0; i < n; ++i) {
            const V xi = _mm512_load_ps(x + 16 * i), yi = _mm512_load_ps(y + 16 * i);
            const V zi = _mm512_load_ps(z + 16 * i), ui = _mm512_load_ps(u + 16 * i);
            const V vi = _mm512_load_ps(v + 16 * i), wi = _mm512_load_ps(w + 16 * i);
            const V di = _mm512_load_ps(d + 16 * i), pi = _mm512_load_ps(p + 16 * i);
            V axi = _mm512_load_ps(ax + 16 * i), ayi = _mm512_load_ps(ay + 16 * i);
            V azi = _mm512_load_ps(az + 16 * i);
            for (int j = 0; j < i; ++j) {
                const V dx = _mm512_sub_ps(xi, _mm512_load_ps(x + 16 * j));
                const V dy = _mm512_sub_ps(yi, _mm512_load_ps(y + 16 * j));
                const V dz = _mm512_sub_ps(zi, _mm512_load_ps(z + 16 * j));
                const V r2 = _mm512_fmadd_ps(dx, dx, _mm512_fmadd_ps(dy, dy, _mm512_mul_ps(dz, dz)));
                const V du = _mm512_sub_ps(ui, _mm512_load_ps(u + 16 * j));
                const V dv = _mm512_sub_ps(vi, _mm512_load_ps(v + 16 * j));
                const V dw = _mm512_sub_ps(wi, _mm512_load_ps(w + 16 * j));
                const V vr = _mm512_fmadd_ps(du, dx, _mm512_fmadd_ps(dv, dy, _mm512_mul_ps(dw, dz)));
                const V sum = _mm512_add_ps(di, _mm512_load_ps(d + 16 * j));
                const V below = _mm512_mul_ps(_mm512_add_ps(r2, floor_), sum);
                const V friction = _mm512_div_ps(_mm512_min_ps(vr, zero), below);
                const V both = _mm512_mul_ps(factor, _mm512_add_ps(pi, _mm512_load_ps(p + 16 * j)));
                const V t = _mm512_max_ps(_mm512_fnmadd_ps(_mm512_sqrt_ps(r2), inverse, one), zero);
                const V slope = _mm512_mul_ps(_mm512_mul_ps(t, t), t);
                const V push = _mm512_mul_ps(_mm512_fnmadd_ps(viscosity, friction, both), slope);
                const V fx = _mm512_mul_ps(push, dx), fy = _mm512_mul_ps(push, dy);
                const V fz = _mm512_mul_ps(push, dz);
                axi = _mm512_add_ps(axi, fx);
                ayi = _mm512_add_ps(ayi, fy);
                azi = _mm512_add_ps(azi, fz);
                _mm512_store_ps(ax + 16 * j, _mm512_sub_ps(_mm512_load_ps(ax + 16 * j), fx));
                _mm512_store_ps(ay + 16 * j, _mm512_sub_ps(_mm512_load_ps(ay + 16 * j), fy));
                _mm512_store_ps(az + 16 * j, _mm512_sub_ps(_mm512_load_ps(az + 16 * j), fz));
            }
            _mm512_store_ps(ax + 16 * i, axi);
            _mm512_store_ps(ay + 16 * i, ayi);
            _mm512_store_ps(az + 16 * i, azi);
        }
        // Something that depends on the forces, or they would be optimised away.
        for (int k = 0; k < 16 * n; ++k) x[k] += 1e-20f * ax[k];
    }
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    std::printf("%g %g\n", seconds.count(), static_cast<double>(ay[3] + az[5]));
}
