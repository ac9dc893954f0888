#pragma once
// Comma-separated tables with a header line (RFC 4180), read record by record.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"

namespace panofix {

// Column order is free; unknown columns are kept and ignored. CRLF, a byte-order mark, blank lines
// and quoted fields are fine. Every failure names the file, the line and the mend.
class CsvReader {
 public:
  // Reads the whole file (kNotFound, kTooLarge above 512 MiB) and its header line, which must hold
  // every name of `columns`, each once; the last `num_optional` of them may be missing and are then
  // blank.
  [[nodiscard]] static Result<CsvReader> Open(const std::filesystem::path& path,
                                              const std::vector<std::string>& columns,
                                              std::size_t num_optional = 0);
  // The same on text in memory; `name` is for messages.
  [[nodiscard]] static Result<CsvReader> Parse(std::string text, const std::string& name,
                                               const std::vector<std::string>& columns,
                                               std::size_t num_optional = 0);

  // Moves to the next record: false at the end. kBadData where a quote is not closed or the number
  // of fields differs from the header's.
  [[nodiscard]] Result<bool> Next();
  // Field of the current record; `column` counts in the order given to Open.
  [[nodiscard]] const std::string& Text(std::size_t column) const {
    static const std::string blank;
    return order_[column] < fields_.size() ? fields_[order_[column]] : blank;
  }
  [[nodiscard]] bool IsBlank(std::size_t column) const;
  [[nodiscard]] Result<std::int64_t> Integer(std::size_t column) const;
  // Finite and within [low, high].
  [[nodiscard]] Result<double> Number(std::size_t column, double low, double high) const;
  // kBadData "file:line: fault; mend" for the current record.
  [[nodiscard]] Status Bad(const std::string& fault, const std::string& mend) const;

 private:
  [[nodiscard]] Result<bool> ReadRecord();
  [[nodiscard]] Status ReadHeader();
  std::string text_, name_;
  std::vector<std::string> columns_, fields_;
  std::vector<std::size_t> order_;
  std::size_t at_ = 0, num_header_fields_ = 0, num_optional_ = 0;
  std::int64_t next_line_ = 1, line_ = 1;
};

// The field as RFC 4180 writes it: in quotes where it holds a comma, a quote or a line break.
[[nodiscard]] std::string CsvField(std::string_view text);

}  // namespace panofix
