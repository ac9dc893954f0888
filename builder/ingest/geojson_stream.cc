#include "builder/ingest/geojson_stream.h"

#include <nlohmann/json.hpp>
#include <vector>

#include "common/base/log.h"

namespace panofix {
namespace {

constexpr char kRecordSeparator = 0x1E;  // RFC 8142
constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
constexpr std::size_t kMaxNesting = 64;

bool IsBlank(std::string_view text) {
  return text.find_first_not_of(" \t\r\n") == std::string_view::npos;
}

bool Contains(std::string_view text, std::string_view part) {
  return text.find(part) != std::string_view::npos;
}

// Follows JSON's strings and brackets byte by byte.
class BracketTracker {
 public:
  // False where a bracket does not match or the nesting is too deep.
  bool Feed(char c) {
    if (in_string_) {
      if (escaped_) {
        escaped_ = false;
      } else if (c == '\\') {
        escaped_ = true;
      } else if (c == '"') {
        in_string_ = false;
      }
      return true;
    }
    if (c == '"') in_string_ = true;
    if (c == '{' || c == '[') {
      open_.push_back(c == '{' ? '}' : ']');
      return open_.size() <= kMaxNesting;
    }
    if (c == '}' || c == ']') {
      if (open_.empty() || open_.back() != c) return false;
      open_.pop_back();
    }
    return true;
  }
  [[nodiscard]] std::size_t depth() const { return open_.size(); }
  [[nodiscard]] bool in_string() const { return in_string_; }

 private:
  std::vector<char> open_;
  bool in_string_ = false, escaped_ = false;
};

bool IsWholeObject(std::string_view line) {
  const std::size_t begin = line.find_first_not_of(" \t\r");
  if (begin == std::string_view::npos || line[begin] != '{') return false;
  BracketTracker tracker;
  for (const char c : line) {
    if (!tracker.Feed(c)) return false;
  }
  return tracker.depth() == 0 && !tracker.in_string();
}

// A whole first line: a collection on one line, or a sequence's header or feature.
bool IsCollectionLine(const std::string& line) {
  const auto document = nlohmann::json::parse(line, nullptr, false);
  // A feature with NaN in it is no JSON, and still tells what the file is.
  if (!document.is_object()) return Contains(line, "\"features\"");
  return document.contains("features");
}

// Follows a collection and knows when it stands directly in the top-level "features".
class CollectionScanner {
 public:
  // False where the text cannot be JSON.
  bool Feed(char c) {
    const bool was_in_string = tracker_.in_string();
    const std::size_t depth_before = tracker_.depth();
    if (!tracker_.Feed(c)) return false;
    if (depth_before == 1) FollowKeys(c, was_in_string);
    if (tracker_.depth() == 1 && depth_before == 2) in_features_ = false;
    return true;
  }
  [[nodiscard]] bool InFeatures() const { return in_features_ && tracker_.depth() == 2; }
  [[nodiscard]] bool InString() const { return tracker_.in_string(); }
  [[nodiscard]] std::size_t depth() const { return tracker_.depth(); }

 private:
  void FollowKeys(char c, bool was_in_string) {
    constexpr std::size_t kLongestKept = 16;  // only "features" matters
    if (was_in_string && tracker_.in_string()) {
      if (text_.size() < kLongestKept) text_ += c;
    } else if (tracker_.in_string()) {
      text_.clear();
    } else if (c == ':') {
      key_ = text_;
    } else if (c == ',') {
      key_.clear();
    } else if (c == '[') {
      in_features_ = key_ == "features";
    }
  }
  BracketTracker tracker_;
  std::string text_, key_;
  bool in_features_ = false;
};

Status BadAt(std::int64_t line, std::int64_t byte, const std::string& fault) {
  return {ErrorCode::kBadData, Format("line %lld, byte %lld: %s", static_cast<long long>(line),
                                      static_cast<long long>(byte), fault.c_str())};
}

Status TooLargeAt(std::int64_t line, const char* what, std::size_t max_bytes) {
  return {ErrorCode::kTooLarge, Format("line %lld: %s of more than %zu bytes; check the file",
                                       static_cast<long long>(line), what, max_bytes)};
}

}  // namespace

int ByteSource::Next() {
  if (at_ == buffer_.size()) {
    constexpr std::size_t kStep = std::size_t{64} << 10;
    buffer_.resize(kStep);
    stream_.read(buffer_.data(), static_cast<std::streamsize>(kStep));
    buffer_.resize(static_cast<std::size_t>(stream_.gcount()));
    at_ = 0;
    if (buffer_.empty()) return -1;
  }
  const char c = buffer_[at_++];
  ++byte_;
  if (c == '\n') ++line_;
  return static_cast<unsigned char>(c);
}

void ByteSource::Unread(const std::string& text) {
  buffer_ = text + buffer_.substr(at_);
  at_ = 0;
  byte_ -= static_cast<std::int64_t>(text.size());
  line_ -= std::count(text.begin(), text.end(), '\n');
}

bool ByteSource::ReadUntil(char delimiter, std::size_t max_bytes, std::string* text,
                           bool* is_too_long) {
  text->clear();
  *is_too_long = false;
  int c = Next();
  if (c < 0) return false;
  for (; c >= 0 && c != static_cast<unsigned char>(delimiter); c = Next()) {
    if (text->size() < max_bytes) {
      *text += static_cast<char>(c);
    } else {
      *is_too_long = true;
    }
  }
  return true;
}

bool IsSequence(ByteSource& source) {
  // Reads on to a whole line that is not blank, as far as the limit allows.
  std::string consumed;
  const auto read_line = [&] {
    std::string line;
    for (int c = source.Next(); c >= 0; c = source.Next()) {
      consumed += static_cast<char>(c);
      if (c == '\n' && !IsBlank(line)) break;
      line += static_cast<char>(c);
      if (line.size() > kMaxFeatureBytes) break;
    }
    return line;
  };
  std::string first = read_line();
  if (first.starts_with(kByteOrderMark)) {
    first.erase(0, kByteOrderMark.size());
    consumed.erase(0, kByteOrderMark.size());
  }
  bool is_sequence = false;
  if (first.empty() || first[0] == kRecordSeparator) {
    is_sequence = !first.empty();
  } else if (IsWholeObject(first)) {
    is_sequence = !IsCollectionLine(first);
  } else if (Contains(first, "\"features\"") || Contains(first, "\"FeatureCollection\"")) {
    is_sequence = false;
  } else {
    // A damaged first line; the next one tells.
    is_sequence = Contains(first, "\"Feature\"") && IsWholeObject(read_line());
  }
  source.Unread(consumed);
  return is_sequence;
}

Status SliceCollection(ByteSource& source, const FeatureVisitor& visit, std::string* frame) {
  CollectionScanner scanner;
  std::string text;
  FeatureText feature;
  frame->clear();
  bool in_feature = false;
  std::int64_t num_commas = 0;
  while (true) {
    const std::int64_t line = source.line(), byte = source.byte();
    const int next = source.Next();
    if (next < 0) break;
    const char c = static_cast<char>(next);
    const bool starts = !in_feature && scanner.InFeatures() && !scanner.InString() && c == '{';
    if (starts) {
      in_feature = true;
      text.clear();
      feature.number = num_commas + 1;
      feature.line = line;
      feature.byte = byte;
    } else if (!in_feature && scanner.InFeatures() && !scanner.InString() && c == ',') {
      ++num_commas;
    }
    if (!scanner.Feed(c))
      return BadAt(line, byte, "brackets do not match; mend or export the file again");
    if (!in_feature || c == '\n') *frame += c;
    if (in_feature) {
      text += c;
      if (text.size() > kMaxFeatureBytes)
        return TooLargeAt(feature.line, "a feature", kMaxFeatureBytes);
      if (scanner.depth() == 2 && !scanner.InString()) {
        in_feature = false;
        *frame += '0';
        feature.text = text;
        if (Status status = visit(feature); !status.ok()) return status;
      }
    }
    if (frame->size() > kMaxFrameBytes) {
      return TooLargeAt(line, "members beside the features", kMaxFrameBytes);
    }
  }
  if (source.failed()) return {ErrorCode::kIo, "cannot be read to its end; check the disk"};
  if (scanner.depth() != 0 || scanner.InString()) {
    return BadAt(source.line(), source.byte(), "the file ends too early; export or copy it again");
  }
  return {};
}

Status SliceSequence(ByteSource& source, const FeatureVisitor& visit) {
  const int first = source.Next();
  const char delimiter = first == kRecordSeparator ? kRecordSeparator : '\n';
  if (first >= 0 && delimiter == '\n') source.Unread(std::string(1, static_cast<char>(first)));
  std::string text;
  FeatureText record;
  while (true) {
    record.line = source.line();
    record.byte = source.byte();
    if (!source.ReadUntil(delimiter, kMaxFeatureBytes, &text, &record.is_too_long)) break;
    if (IsBlank(text)) continue;
    ++record.number;
    record.text = text;
    if (Status status = visit(record); !status.ok()) return status;
  }
  if (source.failed()) return {ErrorCode::kIo, "cannot be read to its end; check the disk"};
  return {};
}

}  // namespace panofix
