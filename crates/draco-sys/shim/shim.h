// The C face of the shim. Every function is noexcept: a C++ exception becomes a
// status code and a message. The Rust side of these declarations is src/lib.rs.
#ifndef STEADYMESH_DRACO_SHIM_H_
#define STEADYMESH_DRACO_SHIM_H_

#include <cstddef>
#include <cstdint>

extern "C" {

enum SteadymeshDracoCode : int32_t {
  STEADYMESH_DRACO_OK = 0,
  // libdraco refused the input; the message is its own.
  STEADYMESH_DRACO_REJECTED = 1,
  // The decoder asked for more memory than the budget allows.
  STEADYMESH_DRACO_OVER_BUDGET = 2,
  // The bytes hold a point cloud, not a mesh.
  STEADYMESH_DRACO_NOT_A_MESH = 3,
  // libdraco decoded something that contradicts itself.
  STEADYMESH_DRACO_INCONSISTENT = 4,
  // Any other exception, or a broken precondition.
  STEADYMESH_DRACO_INTERNAL = 5,
};

// Zero-terminated, cut where it does not fit.
struct SteadymeshDracoStatus {
  int32_t code;
  char message[252];
};

struct SteadymeshDracoAttribute {
  // draco::GeometryAttribute::Type: 0 position, 1 normal, 2 color,
  // 3 texture coordinate, 4 generic; -1 invalid. 5 is not one of them: a generic
  // attribute that its metadata names "material".
  int32_t semantic;
  // draco::DataType: 1 i8, 2 u8, 3 i16, 4 u16, 5 i32, 6 u32, 7 i64, 8 u64,
  // 9 f32, 10 f64, 11 bool.
  int32_t data_type;
  uint32_t component_count;
  uint32_t unique_id;
  // 1 if integers stand for fractions of their type's largest value.
  uint32_t normalized;
};

struct SteadymeshDracoMesh;
struct SteadymeshDracoEncoded;

// One value per point for every attribute but the positions; null where absent.
struct SteadymeshDracoInput {
  size_t point_count;
  size_t vertex_count;
  size_t face_count;
  const float *positions;            // 3 * vertex_count
  // The vertex of every point, each below vertex_count; null if point i is vertex i.
  const uint32_t *point_vertices;
  const uint32_t *faces;             // 3 * face_count, each below point_count
  const float *normals;              // 3 * point_count
  const uint8_t *colors;             // 4 * point_count
  const float *texture_coordinates;  // 2 * point_count
  const uint16_t *materials;         // point_count
  int32_t position_bits;
  int32_t normal_bits;
  int32_t texture_coordinate_bits;
  int32_t speed;
  // 1 stores connectivity as it is, 0 compresses it with EdgeBreaker.
  int32_t is_sequential;
};

// What the encoder wrote; an id is -1 where the attribute is absent.
struct SteadymeshDracoSummary {
  size_t point_count;
  size_t face_count;
  int32_t position_id;
  int32_t normal_id;
  int32_t color_id;
  int32_t texture_coordinate_id;
  int32_t material_id;
};

void steadymesh_draco_decode(const uint8_t *bytes, size_t length, size_t memory_limit,
                             SteadymeshDracoMesh **out, SteadymeshDracoStatus *status) noexcept;
size_t steadymesh_draco_point_count(const SteadymeshDracoMesh *mesh) noexcept;
size_t steadymesh_draco_face_count(const SteadymeshDracoMesh *mesh) noexcept;
size_t steadymesh_draco_attribute_count(const SteadymeshDracoMesh *mesh) noexcept;
void steadymesh_draco_attribute(const SteadymeshDracoMesh *mesh, size_t index,
                                SteadymeshDracoAttribute *out,
                                SteadymeshDracoStatus *status) noexcept;
// Writes 3 * face_count indices, each checked to be below the point count.
void steadymesh_draco_read_faces(const SteadymeshDracoMesh *mesh, uint32_t *out, size_t capacity,
                                 SteadymeshDracoStatus *status) noexcept;
// Writes component_count * point_count numbers as they are stored, converted to f32.
void steadymesh_draco_read_attribute(const SteadymeshDracoMesh *mesh, size_t index, float *out,
                                     size_t capacity, SteadymeshDracoStatus *status) noexcept;
void steadymesh_draco_free_mesh(SteadymeshDracoMesh *mesh) noexcept;

void steadymesh_draco_encode(const SteadymeshDracoInput *input, SteadymeshDracoEncoded **out,
                             SteadymeshDracoSummary *summary,
                             SteadymeshDracoStatus *status) noexcept;
const uint8_t *steadymesh_draco_encoded_bytes(const SteadymeshDracoEncoded *encoded) noexcept;
size_t steadymesh_draco_encoded_length(const SteadymeshDracoEncoded *encoded) noexcept;
void steadymesh_draco_free_encoded(SteadymeshDracoEncoded *encoded) noexcept;

// Most bytes that this thread's last decode held at once; 0 before the first.
size_t steadymesh_draco_last_peak() noexcept;
// Bytes that the last decode asked for in the request that was refused, or 0.
size_t steadymesh_draco_last_refused() noexcept;

}  // extern "C"

#endif  // STEADYMESH_DRACO_SHIM_H_
