#include "common/drive/csv.h"

#include <charconv>
#include <cmath>
#include <fstream>

#include "common/base/log.h"

namespace panofix {
namespace {

constexpr std::uintmax_t kMaxBytes = std::uintmax_t{512} << 20;
constexpr std::size_t kMaxQuotedBytes = 40;  // of a faulty value shown in a message

std::string_view Trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

// A faulty value as a message shows it: short, on one line.
std::string Shown(std::string_view text) {
  std::string shown(text.substr(0, kMaxQuotedBytes));
  for (char& c : shown) {
    if (static_cast<unsigned char>(c) < ' ') c = '?';
  }
  return "'" + shown + (text.size() > kMaxQuotedBytes ? "…'" : "'");
}

std::string Joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ",") + name;
  return text;
}

}  // namespace

Result<CsvReader> CsvReader::Open(const std::filesystem::path& path,
                                  const std::vector<std::string>& columns,
                                  std::size_t num_optional) {
  const std::string name = path.string();
  std::error_code error;
  const auto bytes = std::filesystem::file_size(path, error);
  std::ifstream file(path, std::ios::binary);
  if (error || !file) {
    const std::string reason = error ? error.message() : "no permission";
    return Status(ErrorCode::kNotFound, name + ": cannot be read (" + reason +
                                            "); it needs a file with columns " + Joined(columns));
  }
  if (bytes > kMaxBytes) {
    return Status(ErrorCode::kTooLarge, name + ": larger than 512 MiB; split the recording");
  }
  std::string text(static_cast<std::size_t>(bytes), '\0');
  if (!file.read(text.data(), static_cast<std::streamsize>(bytes))) {
    return Status(ErrorCode::kIo, name + ": reading failed; check the disk");
  }
  return Parse(std::move(text), name, columns, num_optional);
}

Result<CsvReader> CsvReader::Parse(std::string text, const std::string& name,
                                   const std::vector<std::string>& columns,
                                   std::size_t num_optional) {
  CsvReader reader;
  reader.num_optional_ = num_optional;
  reader.text_ = std::move(text);
  reader.name_ = name;
  reader.columns_ = columns;
  if (reader.text_.starts_with("\xEF\xBB\xBF")) reader.at_ = 3;
  const Status header = reader.ReadHeader();
  if (!header.ok()) return header;
  return reader;
}

Status CsvReader::ReadHeader() {
  const std::string mend = "the header line needs the columns " + Joined(columns_);
  const Result<bool> header = ReadRecord();
  if (!header.ok()) return header.status();
  if (!*header) return Status(ErrorCode::kBadData, name_ + ": is empty; " + mend);
  for (const std::string& column : columns_) {
    std::size_t found = fields_.size();
    for (std::size_t i = 0; i < fields_.size(); ++i) {
      if (Trimmed(fields_[i]) != column) continue;
      if (found != fields_.size()) return Bad("column '" + column + "' stands twice", mend);
      found = i;
    }
    const bool is_needed = order_.size() + num_optional_ < columns_.size();
    if (found == fields_.size() && is_needed)
      return Bad("column '" + column + "' is missing", mend);
    order_.push_back(found < fields_.size() ? found : std::string::npos);
  }
  num_header_fields_ = fields_.size();
  return {};
}

Result<bool> CsvReader::Next() {
  const Result<bool> record = ReadRecord();
  if (!record.ok() || !*record) return record;
  if (fields_.size() != num_header_fields_) {
    return Bad(Format("%zu fields where the header has %zu", fields_.size(), num_header_fields_),
               "write one field a column, quoted where it holds a comma");
  }
  return true;
}

Result<bool> CsvReader::ReadRecord() {
  while (at_ < text_.size() && (text_[at_] == '\n' || text_[at_] == '\r')) {  // blank lines
    if (text_[at_++] == '\n') ++next_line_;
  }
  if (at_ >= text_.size()) return false;
  line_ = next_line_;
  fields_.assign(1, {});
  bool quoted = false;
  for (; at_ < text_.size(); ++at_) {
    const char c = text_[at_];
    if (c == '\n') ++next_line_;
    if (quoted) {
      if (c != '"') {
        fields_.back() += c;
      } else if (at_ + 1 < text_.size() && text_[at_ + 1] == '"') {
        fields_.back() += text_[++at_];
      } else {
        quoted = false;
      }
    } else if (c == '"' && fields_.back().empty()) {
      quoted = true;
    } else if (c == ',') {
      fields_.emplace_back();
    } else if (c == '\n') {
      ++at_;
      break;
    } else if (c != '\r') {
      fields_.back() += c;
    }
  }
  if (quoted) return Bad("a quote is opened and never closed", "close it or take it out");
  return true;
}

bool CsvReader::IsBlank(std::size_t column) const { return Trimmed(Text(column)).empty(); }

Result<std::int64_t> CsvReader::Integer(std::size_t column) const {
  const std::string_view text = Trimmed(Text(column));
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    return Bad(columns_[column] + " " + Shown(text) + " is not an integer",
               "write a whole number of at most 64 bits");
  }
  return value;
}

Result<double> CsvReader::Number(std::size_t column, double low, double high) const {
  const std::string_view text = Trimmed(Text(column));
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) {
    return Bad(columns_[column] + " " + Shown(text) + " is not a finite number",
               "write a decimal number");
  }
  if (value < low || value > high) {
    return Bad(columns_[column] + " " + Shown(text) + Format(" lies outside %g to %g", low, high),
               "check its unit and its column");
  }
  return value;
}

Status CsvReader::Bad(const std::string& fault, const std::string& mend) const {
  return {ErrorCode::kBadData, name_ + ":" + std::to_string(line_) + ": " + fault + "; " + mend};
}

std::string CsvField(std::string_view text) {
  if (text.find_first_of(",\"\r\n") == std::string_view::npos) return std::string(text);
  std::string field = "\"";
  for (const char c : text) field += c == '"' ? std::string("\"\"") : std::string(1, c);
  return field + "\"";
}

}  // namespace panofix
