// A mesh to Draco bytes.
#include <memory>
#include <set>
#include <string>
#include <utility>

#include "draco/compression/expert_encode.h"
#include "shim.h"
#include "status.h"

struct SteadymeshDracoEncoded {
  draco::EncoderBuffer buffer;
};

namespace {

using steadymesh::Guard;
using steadymesh::Report;

struct Values {
  draco::GeometryAttribute::Type semantic;
  draco::DataType data_type;
  uint8_t component_count;
  const void *data;
};

// Adds one value per point and returns the attribute's index, or -1 without data.
int32_t AddAttribute(draco::Mesh *mesh, const Values &values) {
  if (values.data == nullptr) {
    return -1;
  }
  const size_t stride = draco::DataTypeLength(values.data_type) * values.component_count;
  const bool is_color = values.semantic == draco::GeometryAttribute::COLOR;
  draco::GeometryAttribute attribute;
  attribute.Init(values.semantic, nullptr, values.component_count, values.data_type, is_color,
                 static_cast<int64_t>(stride), 0);
  const uint32_t point_count = mesh->num_points();
  const int32_t index = mesh->AddAttribute(attribute, true, point_count);
  if (index >= 0) {
    mesh->attribute(index)->buffer()->Write(0, values.data, stride * point_count);
  }
  return index;
}

// Adds the positions, one per vertex, and says which of them each point has.
int32_t AddPositions(draco::Mesh *mesh, const SteadymeshDracoInput &input) {
  if (input.point_vertices == nullptr) {
    return AddAttribute(mesh, {draco::GeometryAttribute::POSITION, draco::DT_FLOAT32, 3,
                               input.positions});
  }
  const auto vertex_count = static_cast<uint32_t>(input.vertex_count);
  const int64_t stride = 3 * sizeof(float);
  draco::GeometryAttribute attribute;
  attribute.Init(draco::GeometryAttribute::POSITION, nullptr, 3, draco::DT_FLOAT32, false, stride,
                 0);
  const int32_t index = mesh->AddAttribute(attribute, false, vertex_count);
  if (index < 0) {
    return index;
  }
  draco::PointAttribute *positions = mesh->attribute(index);
  positions->buffer()->Write(0, input.positions, static_cast<size_t>(stride) * vertex_count);
  for (uint32_t point = 0; point < mesh->num_points(); ++point) {
    positions->SetPointMapEntry(draco::PointIndex(point),
                                draco::AttributeValueIndex(input.point_vertices[point]));
  }
  return index;
}

struct Indices {
  int32_t position;
  int32_t normal;
  int32_t color;
  int32_t texture_coordinate;
  int32_t material;
};

// Adds the number of each point's material. Described as by Draco's own reader of OBJ files: its
// writer refuses a mesh that does not name its materials and their file.
int32_t AddMaterials(draco::Mesh *mesh, const SteadymeshDracoInput &input) {
  const int32_t index = AddAttribute(
      mesh, {draco::GeometryAttribute::GENERIC, draco::DT_UINT16, 1, input.materials});
  if (index >= 0) {
    auto metadata = std::make_unique<draco::AttributeMetadata>();
    metadata->AddEntryString("name", "material");
    metadata->AddEntryString("file_name", "frame.mtl");
    const std::set<uint16_t> numbers(input.materials, input.materials + input.point_count);
    for (const uint16_t number : numbers) {
      metadata->AddEntryInt("material" + std::to_string(number), number);
    }
    mesh->AddAttributeMetadata(index, std::move(metadata));
  }
  return index;
}

Indices FillMesh(const SteadymeshDracoInput &input, draco::Mesh *mesh) {
  mesh->set_num_points(static_cast<uint32_t>(input.point_count));
  mesh->SetNumFaces(input.face_count);
  for (size_t face = 0; face < input.face_count; ++face) {
    const uint32_t *corners = input.faces + 3 * face;
    mesh->SetFace(draco::FaceIndex(static_cast<uint32_t>(face)),
                  {draco::PointIndex(corners[0]), draco::PointIndex(corners[1]),
                   draco::PointIndex(corners[2])});
  }
  using Attribute = draco::GeometryAttribute;
  return {
      AddPositions(mesh, input),
      AddAttribute(mesh, {Attribute::NORMAL, draco::DT_FLOAT32, 3, input.normals}),
      AddAttribute(mesh, {Attribute::COLOR, draco::DT_UINT8, 4, input.colors}),
      AddAttribute(mesh, {Attribute::TEX_COORD, draco::DT_FLOAT32, 2, input.texture_coordinates}),
      AddMaterials(mesh, input),
  };
}

void SetOptions(const SteadymeshDracoInput &input, const Indices &indices,
                draco::ExpertEncoder *encoder) {
  encoder->SetSpeedOptions(input.speed, input.speed);
  encoder->SetEncodingMethod(input.is_sequential != 0 ? draco::MESH_SEQUENTIAL_ENCODING
                                                      : draco::MESH_EDGEBREAKER_ENCODING);
  encoder->SetTrackEncodedProperties(true);
  // Above speed 5 libdraco would tear vertices apart where their points differ.
  encoder->options().SetGlobalBool("split_mesh_on_seams", input.point_vertices == nullptr &&
                                                              6 <= input.speed);
  const std::pair<int32_t, int32_t> bits[] = {
      {indices.position, input.position_bits},
      {indices.normal, input.normal_bits},
      {indices.texture_coordinate, input.texture_coordinate_bits},
  };
  for (const auto &[index, bit_count] : bits) {
    if (index >= 0) {
      encoder->SetAttributeQuantization(index, bit_count);
    }
  }
}

int32_t UniqueId(const draco::Mesh &mesh, int32_t index) {
  return index < 0 ? -1 : static_cast<int32_t>(mesh.attribute(index)->unique_id());
}

void Encode(const SteadymeshDracoInput &input, SteadymeshDracoEncoded **out,
            SteadymeshDracoSummary *summary, SteadymeshDracoStatus *status) {
  draco::Mesh mesh;
  const Indices indices = FillMesh(input, &mesh);
  draco::ExpertEncoder encoder(mesh);
  SetOptions(input, indices, &encoder);
  auto encoded = std::make_unique<SteadymeshDracoEncoded>();
  const draco::Status result = encoder.EncodeToBuffer(&encoded->buffer);
  if (!result.ok()) {
    Report(status, STEADYMESH_DRACO_REJECTED, result.error_msg());
    return;
  }
  *summary = {encoder.num_encoded_points(),     encoder.num_encoded_faces(),
              UniqueId(mesh, indices.position), UniqueId(mesh, indices.normal),
              UniqueId(mesh, indices.color),    UniqueId(mesh, indices.texture_coordinate),
              UniqueId(mesh, indices.material)};
  *out = encoded.release();
}

}  // namespace

void steadymesh_draco_encode(const SteadymeshDracoInput *input, SteadymeshDracoEncoded **out,
                             SteadymeshDracoSummary *summary,
                             SteadymeshDracoStatus *status) noexcept {
  *out = nullptr;
  Guard(status, [&] { Encode(*input, out, summary, status); });
}

const uint8_t *steadymesh_draco_encoded_bytes(const SteadymeshDracoEncoded *encoded) noexcept {
  return reinterpret_cast<const uint8_t *>(encoded->buffer.data());
}

size_t steadymesh_draco_encoded_length(const SteadymeshDracoEncoded *encoded) noexcept {
  return encoded->buffer.size();
}

void steadymesh_draco_free_encoded(SteadymeshDracoEncoded *encoded) noexcept { delete encoded; }
