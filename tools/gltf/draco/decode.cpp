#include <draco/compression/mesh/mesh_edgebreaker_decoder.h>
#include <draco/compression/mesh/mesh_sequential_decoder.h>
#include <draco/core/draco_version.h>
#include <draco/core/varint_decoding.h>
#include <draco/mesh/mesh.h>

#include <cstring>
#include <exception>
#include <new>
#include <optional>
#include <string>
#include <type_traits>

#include "tools/gltf/draco/source.h"

// libdraco throws if memory is short, and trusts the sizes in a stream. So classes derived from its decoders check the
// sizes first, and no exception leaves this file.
namespace scree::convert {
namespace {

Error malformed(const std::string& what) {
  return {ErrorCode::kFormat, what};
}

/// Removes the full stop at the end of some of libdraco's messages.
std::string message_of(const draco::Status& status) {
  std::string text = status.error_msg_string();
  while (text.ends_with('.')) text.pop_back();
  return text.empty() ? "the stream is malformed" : text;
}

/// Limits: bytes per vertex of attributes that the primitive does not name, and the number of all attributes.
constexpr uint64_t kUnnamedBytes = 64;
constexpr int32_t kMaxAttributes = 64;

draco::DataType data_type_of(ComponentType type) {
  return visit_component(type, []<class T>(T) {
    if constexpr (std::is_same_v<T, float>) return draco::DT_FLOAT32;
    if constexpr (sizeof(T) == 4) return draco::DT_UINT32;
    if constexpr (sizeof(T) == 2) return std::is_signed_v<T> ? draco::DT_INT16 : draco::DT_UINT16;
    return std::is_signed_v<T> ? draco::DT_INT8 : draco::DT_UINT8;
  });
}

/// One of libdraco's two decoders. It stops if the sizes in the stream differ from the primitive's.
template <class Decoder>
class CheckedDecoder final : public Decoder {
 public:
  explicit CheckedDecoder(const DracoPrimitive& primitive) : primitive_(primitive) {}

  std::optional<Error> error;  // the reason it stopped

 protected:
  bool DecodeConnectivity() override {
    constexpr bool kIsSequential = std::is_same_v<Decoder, draco::MeshSequentialDecoder>;
    draco::DecoderBuffer head(*this->buffer());
    // The header of an Edgebreaker stream has the number of split vertices (until version 2.1), of vertices before
    // seams divide them, and of triangles. A sequential stream has the number of triangles, then of vertices. The
    // numbers have 32 bits until version 1.9 (sequential: until 2.1) and a variable length in later ones.
    const bool is_old = this->bitstream_version() < DRACO_BITSTREAM_VERSION(2, 2);
    const bool is_fixed = kIsSequential ? is_old : this->bitstream_version() < DRACO_BITSTREAM_VERSION(2, 0);
    const auto number = [&](uint32_t& value) {
      return is_fixed ? head.Decode(&value) : draco::DecodeVarint(&value, &head);
    };
    uint32_t split = 0, vertices = 0, triangles = 0;
    const bool is_read = kIsSequential ? number(triangles) && number(vertices)
                                       : (!is_old || number(split)) && number(vertices) && number(triangles);
    if (!is_read) return stop({ErrorCode::kTruncated, "the stream ends in its header"});
    if (triangles != primitive_.triangles)
      return stop({ErrorCode::kRange, std::to_string(triangles) + " triangles, but the accessor of its indices has " +
                                          std::to_string(primitive_.triangles)});
    if (vertices > primitive_.vertices)
      return stop({ErrorCode::kRange, std::to_string(vertices) + " vertices, but the accessor of POSITION has " +
                                          std::to_string(primitive_.vertices)});
    return Decoder::DecodeConnectivity();
  }

  bool DecodeAllAttributes() override {
    const draco::PointCloud& points = *this->point_cloud();
    if (points.num_points() != primitive_.vertices)
      return stop({ErrorCode::kRange, std::to_string(points.num_points()) +
                                          " vertices, but the accessor of POSITION has " +
                                          std::to_string(primitive_.vertices)});
    uint64_t bytes = 0, most = kUnnamedBytes + 4 * primitive_.other_components;
    for (int32_t i = 0; i < points.num_attributes(); ++i)
      bytes += uint64_t{points.attribute(i)->num_components()} *
               static_cast<uint64_t>(draco::DataTypeLength(points.attribute(i)->data_type()));
    for (const DracoArray& array : primitive_.arrays) most += uint64_t{4} * array.components;
    if (bytes > most || points.num_attributes() > kMaxAttributes)
      return stop({ErrorCode::kUnsupported, std::to_string(points.num_attributes()) + " attributes of " +
                                                std::to_string(bytes) + " bytes per vertex, but the primitive has " +
                                                std::to_string(most) + " at most"});
    return Decoder::DecodeAllAttributes();
  }

 private:
  bool stop(Error why) {
    error = std::move(why);
    return false;
  }

  const DracoPrimitive& primitive_;
};

template <class Decoder>
Result<void> decode_mesh(const DracoPrimitive& primitive, std::span<const std::byte> stream, draco::Mesh& mesh) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(stream.data()), stream.size());
  CheckedDecoder<Decoder> decoder(primitive);
  const draco::DecoderOptions options;
  const draco::Status status = decoder.Decode(options, &buffer, &mesh);
  if (decoder.error) return *decoder.error;
  if (status.ok()) return {};
  const bool is_version =
      status.code() == draco::Status::UNKNOWN_VERSION || status.code() == draco::Status::UNSUPPORTED_VERSION;
  return Error{is_version ? ErrorCode::kUnsupported : ErrorCode::kFormat, message_of(status)};
}

template <class T>
bool convert_values(const draco::PointAttribute& from, uint32_t components, uint64_t count, std::byte* out) {
  for (uint32_t i = 0; i < count; ++i, out += components * sizeof(T)) {
    const draco::AttributeValueIndex value = from.mapped_index(draco::PointIndex(i));
    T converted[4];
    if (value.value() >= from.size() || !from.ConvertValue(value, static_cast<int8_t>(components), converted))
      return false;
    std::memcpy(out, converted, components * sizeof(T));
  }
  return true;
}

/// Copies values that have the accessor's type, unchanged.
bool copy_values(const draco::PointAttribute& from, uint64_t bytes, uint64_t count, std::byte* out) {
  for (uint32_t i = 0; i < count; ++i, out += bytes) {
    const draco::AttributeValueIndex value = from.mapped_index(draco::PointIndex(i));
    if (value.value() >= from.size()) return false;
    const uint8_t* const place = from.GetAddress(value);
    if (!from.IsAddressValid(place) || !from.IsAddressValid(place + bytes - 1)) return false;
    std::memcpy(out, place, bytes);
  }
  return true;
}

Result<void> take_array(const draco::Mesh& mesh, const DracoArray& array, uint64_t count, std::byte* out) {
  const draco::PointAttribute* const from = mesh.GetAttributeByUniqueId(array.id);
  if (from == nullptr) return malformed(array.name + ": no attribute " + std::to_string(array.id) + " in the stream");
  if (from->num_components() != array.components)
    return malformed(array.name + ": " + std::to_string(from->num_components()) +
                     " components in the stream, but its accessor has " + std::to_string(array.components));
  const draco::DataType type = data_type_of(array.type);
  bool is_done = false;
  if (from->data_type() == type) {
    is_done = copy_values(*from, static_cast<uint64_t>(draco::DataTypeLength(type)) * array.components, count, out);
  } else if (from->data_type() != draco::DT_BOOL) {  // whose bytes may be invalid as bool
    is_done =
        visit_component(array.type, [&]<class T>(T) { return convert_values<T>(*from, array.components, count, out); });
  }
  if (!is_done) return malformed(array.name + ": values of another type than its accessor can hold");
  return {};
}

Result<void> decode_or_throw(const DracoPrimitive& primitive, std::span<const std::byte> stream,
                             std::span<std::byte> out) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(stream.data()), stream.size());
  draco::DracoHeader header{};
  if (const draco::Status status = draco::PointCloudDecoder::DecodeHeader(&buffer, &header); !status.ok())
    return malformed("no Draco stream: " + message_of(status));
  if (header.encoder_type != draco::TRIANGULAR_MESH)
    return Error{ErrorCode::kUnsupported, "a point cloud, but its primitive has triangles"};
  draco::Mesh mesh;
  Result<void> done;
  if (header.encoder_method == draco::MESH_EDGEBREAKER_ENCODING) {
    done = decode_mesh<draco::MeshEdgebreakerDecoder>(primitive, stream, mesh);
  } else if (header.encoder_method == draco::MESH_SEQUENTIAL_ENCODING) {
    done = decode_mesh<draco::MeshSequentialDecoder>(primitive, stream, mesh);
  } else {
    done = Error{ErrorCode::kUnsupported, "encoded by method " + std::to_string(header.encoder_method)};
  }
  if (!done) return done;
  if (mesh.num_faces() != primitive.triangles || mesh.num_points() != primitive.vertices)
    return malformed(std::to_string(mesh.num_faces()) + " triangles and " + std::to_string(mesh.num_points()) +
                     " vertices were decoded, expected " + std::to_string(primitive.triangles) + " and " +
                     std::to_string(primitive.vertices));
  std::byte* corners = out.data();
  for (uint32_t i = 0; i < mesh.num_faces(); ++i)
    for (const draco::PointIndex& corner : mesh.face(draco::FaceIndex(i))) {
      const uint32_t value = corner.value();
      std::memcpy(corners, &value, sizeof value);
      corners += sizeof value;
    }
  for (size_t i = 0; i < primitive.arrays.size(); ++i) {
    std::byte* const place = out.data() + *primitive.offset_of(i);
    SCREE_TRY(take_array(mesh, primitive.arrays[i], primitive.vertices, place));
  }
  return {};
}

}  // namespace

std::string draco_version() {
  return draco::kDracoVersion;
}

Result<void> decode_draco(const DracoPrimitive& primitive, std::span<const std::byte> stream,
                          std::span<std::byte> out) {
  try {
    return decode_or_throw(primitive, stream, out);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory to unpack it"};
  } catch (const std::exception& exception) {  // such as std::length_error
    return malformed(std::string("the stream is malformed: ") + exception.what());
  }
}

}  // namespace scree::convert
