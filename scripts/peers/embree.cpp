// Occlusion queries per second by Embree on the segments that `cargo bench --bench visibility -- --write` left: one row for single rays and
// one for packets of 16, in the form of that benchmark. Usage: embree REPEAT FILE...
// Rays are set up before the clock starts.
#include <embree3/rtcore.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

namespace {

constexpr float END = 1e-4f;

struct Segment {
    float from[3], to[3];
};

struct Workload {
    std::vector<float> corners;
    std::vector<Segment> segments;
};

Workload load(const char *path) {
    std::FILE *file = std::fopen(path, "rb");
    std::uint32_t counts[2];
    if (!file || std::fread(counts, 4, 2, file) != 2) {
        std::fprintf(stderr, "%s: expected a file of segments\n", path);
        std::exit(1);
    }
    Workload work{std::vector<float>(9 * std::size_t(counts[0])), std::vector<Segment>(counts[1])};
    bool whole = std::fread(work.corners.data(), 4, work.corners.size(), file) == work.corners.size() &&
                 std::fread(work.segments.data(), sizeof(Segment), counts[1], file) == counts[1];
    std::fclose(file);
    if (!whole) {
        std::fprintf(stderr, "%s: ends too early\n", path);
        std::exit(1);
    }
    return work;
}

RTCScene build(RTCDevice device, const std::vector<float> &corners) {
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    std::size_t count = corners.size() / 9;
    auto *vertices = static_cast<float *>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, 3 * count));
    std::copy(corners.begin(), corners.end(), vertices);
    auto *indices = static_cast<unsigned *>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, count));
    for (unsigned i = 0; i < 3 * count; i++) indices[i] = i;
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene);
    return scene;
}

RTCRay ray_of(const Segment &s) {
    RTCRay ray{};
    ray.org_x = s.from[0], ray.org_y = s.from[1], ray.org_z = s.from[2];
    ray.dir_x = s.to[0] - s.from[0], ray.dir_y = s.to[1] - s.from[1], ray.dir_z = s.to[2] - s.from[2];
    ray.tnear = END, ray.tfar = 1 - END, ray.mask = ~0u;
    return ray;
}

template <class Rays, class Ask>
double seconds(Rays &rays, Ask ask) {
    auto start = std::chrono::steady_clock::now();
    for (auto &ray : rays) ask(ray);
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// The file's name without directories and ending: SCENE SIZE KIND.
void row(const std::string &path, const char *structure, std::vector<double> times, std::size_t count, std::size_t blocked) {
    std::string name = path.substr(path.find_last_of('/') + 1);
    name = name.substr(0, name.find_last_of('.'));
    std::size_t cut = name.find_last_of(' ');
    std::sort(times.begin(), times.end());
    auto rate = [&](double t) { return count / t / 1e6; };
    std::printf("| %s | %s | %.0f %% | %s | %.2f | %.2f–%.2f | |\n", name.substr(0, cut).c_str(), name.substr(cut + 1).c_str(),
                100.0 * blocked / count, structure, rate(times[times.size() / 2]), rate(times.back()), rate(times.front()));
}

}  // namespace

int main(int argc, char **argv) {
    if (argc < 3) {
        std::fprintf(stderr, "usage: embree REPEAT FILE...\n");
        return 2;
    }
    RTCDevice device = rtcNewDevice("threads=1");
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    for (int i = 2; i < argc; i++) {
        Workload work = load(argv[i]);
        RTCScene scene = build(device, work.corners);
        std::size_t count = work.segments.size();
        bool coherent = std::string(argv[i]).find("pairs") == std::string::npos;
        context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
        std::vector<RTCRay> single(count);
        std::vector<RTCRay16> packets((count + 15) / 16);
        alignas(64) static const int all[16] = {-1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1};
        std::vector<double> times[2];
        std::size_t blocked[2];
        for (int repeat = std::atoi(argv[1]); repeat > 0; repeat--) {
            blocked[0] = blocked[1] = 0;
            for (std::size_t r = 0; r < 16 * packets.size(); r++) {
                RTCRay ray = ray_of(work.segments[std::min(r, count - 1)]);
                RTCRay16 &packet = packets[r / 16];
                std::size_t k = r % 16;
                packet.org_x[k] = ray.org_x, packet.org_y[k] = ray.org_y, packet.org_z[k] = ray.org_z;
                packet.dir_x[k] = ray.dir_x, packet.dir_y[k] = ray.dir_y, packet.dir_z[k] = ray.dir_z;
                packet.tnear[k] = ray.tnear, packet.tfar[k] = ray.tfar, packet.mask[k] = ray.mask;
                packet.time[k] = 0, packet.id[k] = 0, packet.flags[k] = 0;
                if (r < count) single[r] = ray;
            }
            times[0].push_back(seconds(single, [&](RTCRay &ray) { rtcOccluded1(scene, &context, &ray); }));
            times[1].push_back(seconds(packets, [&](RTCRay16 &ray) { rtcOccluded16(all, scene, &context, &ray); }));
            for (std::size_t r = 0; r < count; r++) {
                blocked[0] += single[r].tfar < 0;
                blocked[1] += packets[r / 16].tfar[r % 16] < 0;
            }
        }
        row(argv[i], "embree 1", times[0], count, blocked[0]);
        row(argv[i], "embree 16", times[1], count, blocked[1]);
        rtcReleaseScene(scene);
    }
    rtcReleaseDevice(device);
}
