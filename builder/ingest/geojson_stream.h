#pragma once
// Cuts a GeoJSON FeatureCollection or a GeoJSON text sequence into its features, one at a time.

#include <cstddef>
#include <cstdint>
#include <functional>
#include <istream>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace panofix {

inline constexpr std::size_t kMaxFeatureBytes = std::size_t{1} << 20;
// Of a collection without its features; two bytes a feature remain.
inline constexpr std::size_t kMaxFrameBytes = std::size_t{16} << 20;

// One feature's text as it stands in the file. Positions count from 1.
struct FeatureText {
  std::string_view text;
  std::int64_t number = 0;  // of the feature, or of the record of a sequence
  std::int64_t line = 0;    // where it starts
  std::int64_t byte = 0;
  bool is_too_long = false;  // sequences only: `text` was cut at the limit
};
using FeatureVisitor = std::function<Status(const FeatureText&)>;

// Bytes of a stream with their position, and a look ahead.
class ByteSource {
 public:
  explicit ByteSource(std::istream& stream) : stream_(stream) {}
  // The next byte, or -1 at the end.
  int Next();
  // Puts `text`, read last, back in front.
  void Unread(const std::string& text);
  // Reads to the delimiter, which is not kept, or the end; bytes past `max_bytes` are dropped and
  // flagged. False at the end of the stream.
  bool ReadUntil(char delimiter, std::size_t max_bytes, std::string* text, bool* is_too_long);
  [[nodiscard]] std::int64_t line() const { return line_; }
  [[nodiscard]] std::int64_t byte() const { return byte_; }
  [[nodiscard]] bool failed() const { return stream_.bad(); }

 private:
  std::istream& stream_;
  std::string buffer_;
  std::size_t at_ = 0;
  std::int64_t line_ = 1, byte_ = 1;
};

// Whether what follows is a sequence (a feature a line, or records that start with 0x1E) rather
// than one JSON document. Judged from the first two lines; nothing is consumed.
[[nodiscard]] bool IsSequence(ByteSource& source);

// Visits the objects of the top-level array "features". `frame` receives the document with a 0 in
// each one's place and all line breaks kept, for a JSON parser to judge. Fails where brackets do
// not match, a limit is passed or a visit fails; the message holds line and byte.
[[nodiscard]] Status SliceCollection(ByteSource& source, const FeatureVisitor& visit,
                                     std::string* frame);

// Visits the records of a sequence, blank ones left out.
[[nodiscard]] Status SliceSequence(ByteSource& source, const FeatureVisitor& visit);

}  // namespace panofix
