// Draco bytes to a mesh, every index checked before it is followed.
#include <cstring>
#include <memory>
#include <string>

#include "budget.h"
#include "draco/compression/decode.h"
#include "shim.h"
#include "status.h"

struct SteadymeshDracoMesh {
  std::unique_ptr<draco::Mesh> mesh;
};

namespace {

using steadymesh::Guard;
using steadymesh::Report;

void Decode(const uint8_t *bytes, size_t length, SteadymeshDracoMesh **out,
            SteadymeshDracoStatus *status) {
  const char *text = reinterpret_cast<const char *>(bytes);
  draco::DecoderBuffer buffer;
  buffer.Init(text, length);
  auto type = draco::Decoder::GetEncodedGeometryType(&buffer);
  if (!type.ok()) {
    Report(status, STEADYMESH_DRACO_REJECTED, type.status().error_msg());
    return;
  }
  if (type.value() != draco::TRIANGULAR_MESH) {
    Report(status, STEADYMESH_DRACO_NOT_A_MESH, "the bytes hold a point cloud");
    return;
  }
  buffer.Init(text, length);
  draco::Decoder decoder;
  auto mesh = decoder.DecodeMeshFromBuffer(&buffer);
  if (!mesh.ok()) {
    Report(status, STEADYMESH_DRACO_REJECTED, mesh.status().error_msg());
    return;
  }
  auto handle = std::make_unique<SteadymeshDracoMesh>();
  handle->mesh = std::move(mesh).value();
  *out = handle.release();
}

template <typename Stored>
float Load(const uint8_t *address) {
  Stored value;
  std::memcpy(&value, address, sizeof(value));
  return static_cast<float>(value);
}

using Loader = float (*)(const uint8_t *);

Loader LoaderFor(draco::DataType type) {
  switch (type) {
    case draco::DT_INT8: return Load<int8_t>;
    case draco::DT_UINT8: return Load<uint8_t>;
    case draco::DT_INT16: return Load<int16_t>;
    case draco::DT_UINT16: return Load<uint16_t>;
    case draco::DT_INT32: return Load<int32_t>;
    case draco::DT_UINT32: return Load<uint32_t>;
    case draco::DT_INT64: return Load<int64_t>;
    case draco::DT_UINT64: return Load<uint64_t>;
    case draco::DT_FLOAT32: return Load<float>;
    case draco::DT_FLOAT64: return Load<double>;
    case draco::DT_BOOL: return Load<uint8_t>;
    default: return nullptr;
  }
}

// Where the values of an attribute lie, with what is needed to check each address.
struct Layout {
  const uint8_t *data;
  uint64_t data_size;
  uint64_t offset;
  uint64_t stride;
  uint64_t value_size;
  uint64_t component_size;
  Loader load;
};

bool LayoutOf(const draco::PointAttribute &attribute, Layout *layout) {
  const Loader load = LoaderFor(attribute.data_type());
  const draco::DataBuffer *buffer = attribute.buffer();
  if (load == nullptr || buffer == nullptr || attribute.byte_stride() < 0 ||
      attribute.byte_offset() < 0) {
    return false;
  }
  const uint64_t component_size = draco::DataTypeLength(attribute.data_type());
  *layout = {buffer->data(),
             buffer->data_size(),
             static_cast<uint64_t>(attribute.byte_offset()),
             static_cast<uint64_t>(attribute.byte_stride()),
             component_size * attribute.num_components(),
             component_size,
             load};
  return true;
}

void ReadAttribute(const draco::Mesh &mesh, const draco::PointAttribute &attribute, float *out,
                   SteadymeshDracoStatus *status) {
  Layout layout;
  if (!LayoutOf(attribute, &layout)) {
    Report(status, STEADYMESH_DRACO_INCONSISTENT, "an attribute has no readable data type");
    return;
  }
  const uint32_t point_count = mesh.num_points();
  if (!attribute.is_mapping_identity() && attribute.indices_map_size() < point_count) {
    Report(status, STEADYMESH_DRACO_INCONSISTENT, "an attribute does not cover every point");
    return;
  }
  for (uint32_t point = 0; point < point_count; ++point) {
    const uint64_t value = attribute.mapped_index(draco::PointIndex(point)).value();
    // Neither factor exceeds 2^32 by much, so the product cannot wrap.
    const uint64_t start = layout.offset + value * layout.stride;
    if (value >= attribute.size() || start > layout.data_size ||
        layout.value_size > layout.data_size - start) {
      Report(status, STEADYMESH_DRACO_INCONSISTENT, "a point refers to a value that is not there");
      return;
    }
    for (uint64_t at = 0; at < layout.value_size; at += layout.component_size) {
      *out++ = layout.load(layout.data + start + at);
    }
  }
}

void ReadFaces(const draco::Mesh &mesh, uint32_t *out, SteadymeshDracoStatus *status) {
  const uint32_t point_count = mesh.num_points();
  for (uint32_t index = 0; index < mesh.num_faces(); ++index) {
    for (const draco::PointIndex &point : mesh.face(draco::FaceIndex(index))) {
      if (point.value() >= point_count) {
        Report(status, STEADYMESH_DRACO_INCONSISTENT, "a face refers to a point that is not there");
        return;
      }
      *out++ = point.value();
    }
  }
}

// 5 for the number of a material, which is a generic attribute with a name.
int32_t SemanticOf(const draco::Mesh &mesh, int32_t index) {
  const draco::GeometryAttribute::Type type = mesh.attribute(index)->attribute_type();
  const auto *metadata = mesh.GetAttributeMetadataByAttributeId(index);
  std::string name;
  const bool is_material = type == draco::GeometryAttribute::GENERIC && metadata != nullptr &&
                           metadata->GetEntryString("name", &name) && name == "material";
  return is_material ? 5 : type;
}

const draco::PointAttribute *Find(const SteadymeshDracoMesh *mesh, size_t index,
                                  SteadymeshDracoStatus *status) {
  if (index >= static_cast<size_t>(mesh->mesh->num_attributes())) {
    Report(status, STEADYMESH_DRACO_INTERNAL, "no attribute has this index");
    return nullptr;
  }
  return mesh->mesh->attribute(static_cast<int32_t>(index));
}

}  // namespace

void steadymesh_draco_decode(const uint8_t *bytes, size_t length, size_t memory_limit,
                             SteadymeshDracoMesh **out, SteadymeshDracoStatus *status) noexcept {
  *out = nullptr;
  {
    const steadymesh::BudgetScope scope(memory_limit);
    Guard(status, [&] { Decode(bytes, length, out, status); });
  }
  // libdraco turns some refused allocations into a refusal of its own.
  if (status->code != STEADYMESH_DRACO_OK && steadymesh_draco_last_refused() != 0) {
    Report(status, STEADYMESH_DRACO_OVER_BUDGET, "out of memory");
  }
}

size_t steadymesh_draco_point_count(const SteadymeshDracoMesh *mesh) noexcept {
  return mesh->mesh->num_points();
}

size_t steadymesh_draco_face_count(const SteadymeshDracoMesh *mesh) noexcept {
  return mesh->mesh->num_faces();
}

size_t steadymesh_draco_attribute_count(const SteadymeshDracoMesh *mesh) noexcept {
  return static_cast<size_t>(mesh->mesh->num_attributes());
}

void steadymesh_draco_attribute(const SteadymeshDracoMesh *mesh, size_t index,
                                SteadymeshDracoAttribute *out,
                                SteadymeshDracoStatus *status) noexcept {
  Guard(status, [&] {
    if (const draco::PointAttribute *attribute = Find(mesh, index, status)) {
      out->semantic = SemanticOf(*mesh->mesh, static_cast<int32_t>(index));
      out->data_type = attribute->data_type();
      out->component_count = attribute->num_components();
      out->unique_id = attribute->unique_id();
      out->normalized = attribute->normalized() ? 1 : 0;
    }
  });
}

void steadymesh_draco_read_faces(const SteadymeshDracoMesh *mesh, uint32_t *out, size_t capacity,
                                 SteadymeshDracoStatus *status) noexcept {
  Guard(status, [&] {
    if (capacity / 3 < mesh->mesh->num_faces()) {
      Report(status, STEADYMESH_DRACO_INTERNAL, "the buffer for the faces is too small");
      return;
    }
    ReadFaces(*mesh->mesh, out, status);
  });
}

void steadymesh_draco_read_attribute(const SteadymeshDracoMesh *mesh, size_t index, float *out,
                                     size_t capacity, SteadymeshDracoStatus *status) noexcept {
  Guard(status, [&] {
    const draco::PointAttribute *attribute = Find(mesh, index, status);
    if (attribute == nullptr) {
      return;
    }
    const uint64_t needed =
        static_cast<uint64_t>(attribute->num_components()) * mesh->mesh->num_points();
    if (capacity < needed) {
      Report(status, STEADYMESH_DRACO_INTERNAL, "the buffer for the attribute is too small");
      return;
    }
    ReadAttribute(*mesh->mesh, *attribute, out, status);
  });
}

void steadymesh_draco_free_mesh(SteadymeshDracoMesh *mesh) noexcept { delete mesh; }
