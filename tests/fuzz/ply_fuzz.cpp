#include "fuzz/fuzz.h"
#include "scene/ply.h"

using namespace cloudrenderer;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::MemoryFile file(fuzz::input(data, size));
  try {
    const PlyMesh mesh = read_ply(file.path(), {});
    const std::size_t vertices = mesh.positions.size();
    for (const glm::u32vec3& t : mesh.triangles.view())
      fuzz::require(t.x < vertices && t.y < vertices && t.z < vertices, "indices are in range");
    fuzz::require(mesh.normals.size() == 0 || mesh.normals.size() == vertices, "a normal a vertex");
    fuzz::require(mesh.uvs.size() == 0 || mesh.uvs.size() == vertices, "a uv a vertex");
    fuzz::require(mesh.faces.size() == mesh.triangles.size(), "a face a triangle");
  } catch (const SceneError& e) {
    fuzz::require(std::string(e.what()).find("error: ") != std::string::npos, "an error says so");
  }
  return 0;
}
