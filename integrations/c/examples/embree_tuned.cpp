// A small ambient-occlusion renderer on Embree's own API whose trees are tuned by a Treewright daemon.
//
//   embree_tuned --url http://127.0.0.1:50611 --frames 60 [--size 64] [--samples 4] [--deadline 50] [--rounds 7] [SCENE.ply ...]
//
// Every frame rebuilds the scene (as for moving geometry) and renders it. What tuning adds stands between the marks
// `tuning:` and `: tuning`. With --rounds the tuned configuration, the default and every fixed one are then measured in turns
// within each round. Lines of JSON go to standard output. Without scenes three are generated.
#include <embree4/rtcore.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <map>
#include <numeric>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "treewright.hpp"
#include "treewright_embree.h"

namespace {

struct Vector {
  float x, y, z;
};
Vector operator+(Vector a, Vector b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
Vector operator-(Vector a, Vector b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Vector operator*(Vector a, float s) { return {a.x * s, a.y * s, a.z * s}; }
float dot(Vector a, Vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Vector cross(Vector a, Vector b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
Vector normal(Vector a) { return a * (1 / std::sqrt(std::max(dot(a, a), 1e-30f))); }

struct Mesh {
  std::string name;
  std::vector<Vector> vertices;
  std::vector<uint32_t> indices;
  size_t triangles() const { return indices.size() / 3; }
};

// Reads the PLY that integrations/scenes.py writes: binary, float positions, triangles.
Mesh read_ply(const std::string &path) {
  std::ifstream file(path, std::ios::binary);
  size_t vertices = 0, faces = 0;
  for (std::string line; std::getline(file, line) && line != "end_header";) {
    std::sscanf(line.c_str(), "element vertex %zu", &vertices);
    std::sscanf(line.c_str(), "element face %zu", &faces);
  }
  Mesh mesh{path.substr(path.rfind('/') + 1), std::vector<Vector>(vertices), std::vector<uint32_t>(3 * faces)};
  file.read(reinterpret_cast<char *>(mesh.vertices.data()), static_cast<std::streamsize>(vertices * sizeof(Vector)));
  for (size_t face = 0; face < faces; face++) {
    file.ignore(1);
    file.read(reinterpret_cast<char *>(&mesh.indices[3 * face]), 12);
  }
  if (!file || faces == 0) throw std::runtime_error(path + " is no binary PLY of triangles");
  for (uint32_t index : mesh.indices)
    if (index >= vertices) throw std::runtime_error(path + " names a vertex that it does not have");
  return mesh;
}

// A height field, a forest of needles, a pile of boxes: three kinds of distribution.
Mesh generate(int kind) {
  uint32_t state = 12345u + static_cast<uint32_t>(kind);
  auto random = [&] { return static_cast<float>((state = state * 1664525u + 1013904223u) >> 8) / 16777216.0f; };
  Mesh mesh{kind == 0 ? "field" : kind == 1 ? "needles" : "boxes", {}, {}};
  auto add = [&](Vector a, Vector b, Vector c) {
    for (Vector corner : {a, b, c}) {
      mesh.indices.push_back(static_cast<uint32_t>(mesh.vertices.size()));
      mesh.vertices.push_back(corner);
    }
  };
  if (kind == 0) {
    auto at = [](int x, int z) {
      float u = static_cast<float>(x) * 0.05f, v = static_cast<float>(z) * 0.05f;
      return Vector{u, std::sin(u * 3) * std::cos(v * 2), v};
    };
    for (int x = 0; x < 120; x++)
      for (int z = 0; z < 120; z++) {
        add(at(x, z), at(x + 1, z), at(x, z + 1));
        add(at(x + 1, z), at(x + 1, z + 1), at(x, z + 1));
      }
  } else {
    for (int each = 0; each < (kind == 1 ? 20000 : 3000); each++) {
      Vector corner{random() * 6, random() * 6, random() * 6};
      if (kind == 1) {
        Vector along = normal({random() - 0.5f, random() - 0.5f, random() - 0.5f}) * 1.5f;
        add(corner, corner + along, corner + along + Vector{0.01f, 0.01f, 0});
        continue;
      }
      float s = 0.02f + 0.2f * random();
      for (int axis = 0; axis < 3; axis++) {
        Vector u = axis == 0 ? Vector{s, 0, 0} : axis == 1 ? Vector{0, s, 0} : Vector{0, 0, s};
        Vector v = axis == 0 ? Vector{0, s, 0} : axis == 1 ? Vector{0, 0, s} : Vector{s, 0, 0};
        add(corner, corner + u, corner + v);
        add(corner + u, corner + u + v, corner + v);
      }
    }
  }
  return mesh;
}

struct Settings {
  std::string url = "http://127.0.0.1:50611";
  int frames = 60, rounds = 0, size = 64, samples = 4, deadline_ms = 50;
};

// Devices by their text: a layout by name needs one of its own.
class Devices {
 public:
  ~Devices() {
    for (auto &each : devices_) rtcReleaseDevice(each.second);
  }
  RTCDevice get(const std::string &text) {
    RTCDevice &device = devices_[text];
    if (!device) device = rtcNewDevice(("threads=1," + text).c_str());
    if (!device) throw std::runtime_error("Embree takes no device " + text);
    return device;
  }

 private:
  std::map<std::string, RTCDevice> devices_;
};

struct Frame {
  double build_ms, render_ms;
  std::vector<float> pixels;
  double brightness() const { return std::accumulate(pixels.begin(), pixels.end(), 0.0) / static_cast<double>(pixels.size()); }
};

// Processor time: all of it is on this thread, and what else the machine does is left out.
double now_ms() { return static_cast<double>(std::clock()) * 1e3 / CLOCKS_PER_SEC; }

struct View {
  Vector eye, target;
  float tangent;
};

View view_of(const Mesh &mesh) {
  Vector low = mesh.vertices[mesh.indices[0]], high = low;
  for (uint32_t index : mesh.indices) {
    Vector p = mesh.vertices[index];
    low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
  }
  Vector middle = (low + high) * 0.5f;
  return {middle + (high - low) * 0.35f, middle, 0.5f};
}

// One primary ray a pixel, and from what it hits, rays over the hemisphere.
std::vector<float> trace(RTCScene scene, const View &view, const Settings &settings) {
  uint32_t state = 0;
  auto random = [&] { return static_cast<float>((state = state * 1664525u + 1013904223u) >> 8) / 16777216.0f; };
  Vector forward = normal(view.target - view.eye), right = normal(cross(forward, {0.01f, 1, 0})), up = cross(right, forward);
  std::vector<float> pixels(static_cast<size_t>(settings.size) * static_cast<size_t>(settings.size));
  for (int pixel = 0; pixel < settings.size * settings.size; pixel++) {
    state = static_cast<uint32_t>(pixel) * 747796405u + 1;  // of its own, so that pixels differ one by one
    float u = (static_cast<float>(pixel % settings.size) + 0.5f) / static_cast<float>(settings.size) * 2 - 1;
    float v = (static_cast<float>(pixel / settings.size) + 0.5f) / static_cast<float>(settings.size) * 2 - 1;
    Vector way = normal(forward + right * (u * view.tangent) + up * (v * view.tangent));
    RTCRayHit hit{};
    hit.ray = {view.eye.x, view.eye.y, view.eye.z, 0, way.x, way.y, way.z, 0, INFINITY, ~0u, 0, 0};
    hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(scene, &hit, nullptr);
    if (hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
    Vector n = normal({hit.hit.Ng_x, hit.hit.Ng_y, hit.hit.Ng_z});
    if (dot(n, way) > 0) n = n * -1;
    Vector at = view.eye + way * hit.ray.tfar + n * (1e-4f * hit.ray.tfar);
    for (int sample = 0; sample < settings.samples; sample++) {
      Vector out = normal(n + normal({random() * 2 - 1, random() * 2 - 1, random() * 2 - 1}));
      RTCRay shadow{at.x, at.y, at.z, 0, out.x, out.y, out.z, 0, INFINITY, ~0u, 0, 0};
      rtcOccluded1(scene, &shadow, nullptr);
      if (shadow.tfar > 0) pixels[static_cast<size_t>(pixel)] += 1.0f / static_cast<float>(settings.samples);
    }
  }
  return pixels;
}

Frame render(Devices &devices, const Mesh &mesh, const View &view, const tw_configuration *configuration,
             const Settings &settings) {
  char text[64];
  tw_embree_device_string(configuration, nullptr, text, sizeof text);
  RTCDevice device = devices.get(text);
  double start = now_ms();
  RTCScene scene = rtcNewScene(device);
  rtcSetSceneFlags(scene, tw_embree_scene_flags(configuration, RTC_SCENE_FLAG_NONE));
  rtcSetSceneBuildQuality(scene, tw_embree_quality(configuration));
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  rtcSetGeometryBuildQuality(geometry, tw_embree_quality(configuration));
  void *vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vector),
                                           mesh.vertices.size());
  void *indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, mesh.triangles());
  std::memcpy(vertices, mesh.vertices.data(), mesh.vertices.size() * sizeof(Vector));
  std::memcpy(indices, mesh.indices.data(), mesh.indices.size() * sizeof(uint32_t));
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene);
  double built = now_ms();
  std::vector<float> pixels = trace(scene, view, settings);
  double rendered = now_ms();
  rtcReleaseScene(scene);
  if (rtcGetDeviceError(device) != RTC_ERROR_NONE) throw std::runtime_error("Embree reports an error");
  return {built - start, rendered - built, std::move(pixels)};
}

std::string list(const std::vector<double> &values) {
  std::ostringstream text;
  text.precision(6);
  for (size_t each = 0; each < values.size(); each++) text << (each ? "," : "[") << values[each];
  return values.empty() ? "[]" : text.str() + "]";
}

size_t pixels_that_differ(const Frame &one, const Frame &other) {
  size_t count = 0;
  for (size_t each = 0; each < one.pixels.size(); each++) count += one.pixels[each] != other.pixels[each];
  return count;
}

// Every fixed configuration of tw_embree_scene_parameters.
const char *const FIXED[] = {"{\"quality\":\"medium\",\"layout\":\"auto\"}",
                             "{\"quality\":\"low\"}",
                             "{\"quality\":\"high\"}",
                             "{\"quality\":\"medium\",\"layout\":\"compact\"}",
                             "{\"quality\":\"medium\",\"layout\":\"bvh4.triangle4\"}",
                             "{\"quality\":\"medium\",\"layout\":\"bvh8.triangle4i\"}",
                             "{\"quality\":\"medium\",\"layout\":\"qbvh8.triangle4\"}"};

// Costs of the tuned configuration and of every fixed one, in turns within each round, and how many pixels each changes.
std::string measure(Devices &devices, const Mesh &mesh, const View &view, tw::ConfigurationView tuned,
                    const Settings &settings) {
  std::vector<std::string> texts{tuned.json()};
  texts.insert(texts.end(), std::begin(FIXED), std::end(FIXED));
  std::vector<std::vector<double>> costs(texts.size());
  std::vector<Frame> last(texts.size());
  std::vector<size_t> turns(texts.size());
  std::iota(turns.begin(), turns.end(), 0);
  std::mt19937 random(1);
  for (int round = 0; round < settings.rounds; round++) {
    // In another order each time: what ran before leaves its mark on caches and memory.
    std::shuffle(turns.begin(), turns.end(), random);
    for (size_t turn : turns) {
      tw::Known fixed = tw::parse(texts[turn]);
      last[turn] = render(devices, mesh, view, fixed.configuration().handle(), settings);
      costs[turn].push_back(last[turn].build_ms + last[turn].render_ms);
    }
  }
  std::ostringstream line;
  line << ",\"tuned_costs\":" << list(costs[0]) << ",\"fixed\":[";
  for (size_t each = 1; each < texts.size(); each++)
    line << (each > 1 ? "," : "") << "{\"configuration\":" << texts[each] << ",\"costs\":" << list(costs[each])
         << ",\"differs\":" << pixels_that_differ(last[0], last[each]) << "}";
  return line.str() + "]";
}

// The best known; the default where no daemon answers, or none did while frames were measured.
tw::Known best_or_default(tw::Client &client, const tw::Study &study, const tw::Numbers &input) {
  try {
    client.flush(5000);
    return study.best(input);
  } catch (const tw::Error &problem) {
    std::fprintf(stderr, "embree_tuned: %s\n", problem.what());
    return tw::parse(FIXED[0]);
  }
}

void tune(const Settings &settings, const std::vector<Mesh> &meshes) {
  // tuning: what can be set, what describes a frame, what is to become small
  tw::Client client(settings.url, tw::Options()
                                      .client_id("embree-example")
                                      .deadline_ms(settings.deadline_ms)
                                      .software("embree", RTC_VERSION_STRING));
  tw::Spec spec;
  tw_embree_scene_parameters(spec.handle(), false);
  spec.scene_indicators().indicator("rays", 0, 1e9, TW_LOG).minimise("build_ms").minimise("render_ms");
  tw::Study study = client.study("embree-example", spec);
  tw::Tuner tuner = study.tuner();
  // : tuning
  Devices devices;
  for (const Mesh &mesh : meshes) {
    View view = view_of(mesh);
    // tuning: the seventeen indicators, from the buffers that Embree gets, and how much is asked of the tree
    tw_mesh buffers{};
    buffers.vertices = &mesh.vertices[0].x;
    buffers.vertex_count = mesh.vertices.size();
    buffers.indices = mesh.indices.data();
    buffers.triangle_count = mesh.triangles();
    buffers.diffuse_share = 1;
    tw_camera camera{{view.eye.x, view.eye.y, view.eye.z}, {view.target.x, view.target.y, view.target.z}, 53};
    tw::Numbers input = tw::Scene({buffers}).indicators(camera);
    input.push_back({"rays", static_cast<double>(settings.size) * settings.size * (1 + settings.samples)});
    // : tuning
    std::vector<double> costs;
    double brightness = -1;
    for (int number = 0; number < settings.frames; number++) {
      tw::Suggestion suggestion = tuner.next(input);  // tuning: ask, at most the deadline whatever happens
      Frame frame = render(devices, mesh, view, suggestion.configuration().handle(), settings);
      tuner.finish(std::move(suggestion), {{"build_ms", frame.build_ms}, {"render_ms", frame.render_ms}});  // and tell
      costs.push_back(frame.build_ms + frame.render_ms);
      if (brightness >= 0 && std::abs(frame.brightness() - brightness) > 2e-3)
        throw std::runtime_error("the picture of " + mesh.name + " depends on the tree");
      brightness = frame.brightness();
    }
    tw::Known best = best_or_default(client, study, input);
    std::string rounds = settings.rounds > 0 ? measure(devices, mesh, view, best.configuration(), settings) : "";
    std::printf("{\"scene\":\"%s\",\"triangles\":%zu,\"use\":\"%d² x %d\",\"trial_costs\":%s,\"tuned\":%s,"
                "\"brightness\":%.4f,\"from_daemon\":%llu%s}\n",
                mesh.name.c_str(), mesh.triangles(), settings.size, settings.samples, list(costs).c_str(),
                best.configuration().json().c_str(), brightness,
                static_cast<unsigned long long>(client.count(TW_COUNT_SUGGESTIONS)), rounds.c_str());
    std::fflush(stdout);
  }
}

}  // namespace

int main(int count, char **arguments) {
  try {
    Settings settings;
    std::vector<Mesh> meshes;
    for (int each = 1; each < count; each++) {
      std::string name = arguments[each];
      if (name.rfind("--", 0) != 0) {
        meshes.push_back(read_ply(name));
        continue;
      }
      if (++each >= count) throw std::runtime_error(name + " needs a value");
      if (name == "--url")
        settings.url = arguments[each];
      else if (name == "--frames")
        settings.frames = std::atoi(arguments[each]);
      else if (name == "--rounds")
        settings.rounds = std::atoi(arguments[each]);
      else if (name == "--size")
        settings.size = std::atoi(arguments[each]);
      else if (name == "--samples")
        settings.samples = std::atoi(arguments[each]);
      else if (name == "--deadline")
        settings.deadline_ms = std::atoi(arguments[each]);
      else
        throw std::runtime_error(name + " is unknown");
    }
    if (meshes.empty())
      for (int kind = 0; kind < 3; kind++) meshes.push_back(generate(kind));
    tune(settings, meshes);
    return 0;
  } catch (const std::exception &problem) {
    std::fprintf(stderr, "embree_tuned: %s\n", problem.what());
    return 1;
  }
}
