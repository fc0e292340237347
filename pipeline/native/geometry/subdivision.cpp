#include "geometry/subdivision.h"

#include <opensubdiv/far/primvarRefiner.h>
#include <opensubdiv/far/topologyDescriptor.h>
#include <opensubdiv/far/topologyRefiner.h>
#include <opensubdiv/far/topologyRefinerFactory.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>

namespace usdfoliage {
namespace {

namespace Far = OpenSubdiv::Far;
namespace Sdc = OpenSubdiv::Sdc;

// What PrimvarRefinerReal wants of a vertex.
struct Point {
    double x = 0, y = 0, z = 0;
    void Clear() { x = y = z = 0; }
    void AddWithWeight(const Point& other, double weight) {
        x += weight * other.x;
        y += weight * other.y;
        z += weight * other.z;
    }
};

// OpenSubdiv reads past its arrays where an index is out of range.
void check_indices(const Cage& cage) {
    const auto refuse = [](const std::string& what) { throw std::invalid_argument("the topology of the cage is wrong: " + what); };
    std::size_t n_corners_of_faces = 0;
    for (std::size_t face = 0; face < cage.n_faces; ++face) {
        if (cage.face_counts[face] < 3) refuse("face " + std::to_string(face) + " has fewer than 3 vertices");
        n_corners_of_faces += static_cast<std::size_t>(cage.face_counts[face]);
    }
    if (n_corners_of_faces != cage.n_indices) {
        refuse("face counts sum to " + std::to_string(n_corners_of_faces) + ", indices are " + std::to_string(cage.n_indices));
    }
    const auto check = [&](const std::int32_t* indices, std::size_t n, const char* of) {
        for (std::size_t i = 0; i < n; ++i) {
            if (indices[i] >= 0 && static_cast<std::size_t>(indices[i]) < cage.n_points) continue;
            refuse(std::string(of) + " index " + std::to_string(indices[i]) + " of " + std::to_string(cage.n_points) + " points");
        }
    };
    check(cage.face_indices, cage.n_indices, "face");
    check(cage.crease_edges, 2 * cage.n_creases, "crease");
    check(cage.corner_vertices, cage.n_corners, "corner");
}

std::unique_ptr<Far::TopologyRefiner> make_refiner(const Cage& cage) {
    check_indices(cage);
    Far::TopologyDescriptor descriptor;
    descriptor.numVertices = static_cast<int>(cage.n_points);
    descriptor.numFaces = static_cast<int>(cage.n_faces);
    descriptor.numVertsPerFace = cage.face_counts;
    descriptor.vertIndicesPerFace = cage.face_indices;
    descriptor.numCreases = static_cast<int>(cage.n_creases);
    descriptor.creaseVertexIndexPairs = cage.crease_edges;
    descriptor.creaseWeights = cage.crease_sharpness;
    descriptor.numCorners = static_cast<int>(cage.n_corners);
    descriptor.cornerVertexIndices = cage.corner_vertices;
    descriptor.cornerWeights = cage.corner_sharpness;

    Sdc::Options scheme;
    scheme.SetVtxBoundaryInterpolation(Sdc::Options::VTX_BOUNDARY_EDGE_AND_CORNER);
    using Factory = Far::TopologyRefinerFactory<Far::TopologyDescriptor>;
    Factory::Options options(Sdc::SCHEME_CATMARK, scheme);
    options.validateFullTopology = true;
    std::unique_ptr<Far::TopologyRefiner> refiner(Factory::Create(descriptor, options));
    if (!refiner) throw std::invalid_argument("OpenSubdiv refuses the topology of the cage");
    return refiner;
}

}  // namespace

RefinedMesh refine_catmull_clark(const Cage& cage, int levels, bool limit) {
    const auto refiner = make_refiner(cage);
    Far::TopologyRefiner::UniformOptions options(levels);
    options.fullTopologyInLastLevel = limit;
    refiner->RefineUniform(options);

    std::vector<Point> source(cage.n_points);
    for (std::size_t i = 0; i < cage.n_points; ++i) {
        source[i] = {cage.points[3 * i], cage.points[3 * i + 1], cage.points[3 * i + 2]};
    }
    const Far::PrimvarRefinerReal<double> primvar(*refiner);
    for (int level = 1; level <= levels; ++level) {
        std::vector<Point> refined(static_cast<std::size_t>(refiner->GetLevel(level).GetNumVertices()));
        primvar.Interpolate(level, source, refined);
        source = std::move(refined);
    }

    RefinedMesh mesh;
    if (limit) {
        std::vector<Point> position(source.size()), tangent_u(source.size()), tangent_v(source.size());
        primvar.Limit(source, position, tangent_u, tangent_v);
        source = std::move(position);
        mesh.normals.reserve(3 * source.size());
        for (std::size_t i = 0; i < source.size(); ++i) {
            const Point &u = tangent_u[i], &v = tangent_v[i];
            const Point n{u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
            const double length = std::sqrt(n.x * n.x + n.y * n.y + n.z * n.z);
            const double scale = length > 0 ? 1 / length : 0;  // a degenerate corner has no normal
            mesh.normals.insert(mesh.normals.end(), {n.x * scale, n.y * scale, n.z * scale});
        }
    }

    mesh.points.reserve(3 * source.size());
    for (const Point& p : source) mesh.points.insert(mesh.points.end(), {p.x, p.y, p.z});

    const Far::TopologyLevel& last = refiner->GetLevel(levels);
    mesh.face_indices.reserve(4 * static_cast<std::size_t>(last.GetNumFaces()));
    for (int face = 0; face < last.GetNumFaces(); ++face) {
        const Far::ConstIndexArray vertices = last.GetFaceVertices(face);
        mesh.face_indices.insert(mesh.face_indices.end(), vertices.begin(), vertices.end());
    }
    return mesh;
}

}  // namespace usdfoliage
