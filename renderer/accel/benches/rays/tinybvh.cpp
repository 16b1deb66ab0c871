// tinybvh's eight-wide tree for processors (BVH8_CPU) behind four C functions, for the benchmark of rays.
//
// tools/tinybvh.sh compiles this file with the header that the crate tinybvh-rs carries; TREEWRIGHT_TINYBVH names the
// library that comes out. A batch is traced by one call, so that the way between the languages costs nothing to speak of.

#define TINYBVH_IMPLEMENTATION
#include "tiny_bvh.h"

#include <memory>

namespace {

// As `FlatRay` in tinybvh.rs: a segment of a ray whose direction need not have length 1.
struct FlatRay {
    float origin[3], t_min, direction[3], t_max;
};

// As `FlatHit` in tinybvh.rs; a distance of infinity stands for a miss.
struct FlatHit {
    float t, u, v;
    uint32_t triangle;
};

struct Tree {
    // The library keeps pointing at the corners.
    std::unique_ptr<tinybvh::bvhvec4[]> corners;
    tinybvh::BVH8_CPU tree;
};

// The library's rays begin at 0 and have directions of length 1. `offset` and `scale` lead back.
tinybvh::Ray prepare(const FlatRay& from, float& offset, float& scale) {
    const tinybvh::bvhvec3 direction(from.direction[0], from.direction[1], from.direction[2]);
    const tinybvh::bvhvec3 origin(from.origin[0], from.origin[1], from.origin[2]);
    scale = tinybvh::tinybvh_length(direction);
    offset = from.t_min;
    const float far = std::isinf(from.t_max) ? BVH_FAR : (from.t_max - from.t_min) * scale;
    return tinybvh::Ray(origin + direction * from.t_min, direction, far);
}

}  // namespace

// Builds a tree over `count` triangles of three corners of four floats each; `splits` asks for the library's
// careful builder, which splits triangles.
extern "C" void* treewright_tinybvh_build(const float* corners, uint32_t count, int splits) {
    auto tree = std::make_unique<Tree>();
    tree->corners = std::make_unique<tinybvh::bvhvec4[]>(size_t(count) * 3);
    std::memcpy(static_cast<void*>(tree->corners.get()), corners, size_t(count) * 3 * sizeof(tinybvh::bvhvec4));
    if (splits) {
        tree->tree.BuildHQ(tree->corners.get(), count);
    } else {
        tree->tree.Build(tree->corners.get(), count);
    }
    return tree.release();
}

extern "C" void treewright_tinybvh_free(void* tree) { delete static_cast<Tree*>(tree); }

extern "C" void treewright_tinybvh_closest(const void* tree, const FlatRay* rays, FlatHit* hits, uint32_t count) {
    const auto& bvh = static_cast<const Tree*>(tree)->tree;
    for (uint32_t i = 0; i < count; ++i) {
        float offset, scale;
        tinybvh::Ray ray = prepare(rays[i], offset, scale);
        const float far = ray.hit.t;
        bvh.Intersect(ray);
        const bool met = ray.hit.t < far;
        hits[i] = {met ? ray.hit.t / scale + offset : INFINITY, ray.hit.u, ray.hit.v, ray.hit.prim};
    }
}

extern "C" void treewright_tinybvh_occluded(const void* tree, const FlatRay* rays, uint8_t* occluded, uint32_t count) {
    const auto& bvh = static_cast<const Tree*>(tree)->tree;
    for (uint32_t i = 0; i < count; ++i) {
        float offset, scale;
        occluded[i] = bvh.IsOccluded(prepare(rays[i], offset, scale));
    }
}
