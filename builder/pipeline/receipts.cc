#include "builder/pipeline/receipts.h"

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "common/io/sha256.h"

namespace panofix {

using Json = nlohmann::json;

// Found by nlohmann's get and assignment.
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(SetAside, id, reason)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(MadeFile, id, key, parts)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ExtractReceipt::Panorama, made, has_depth)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ExtractReceipt, made_from, panoramas, set_aside, without_depth)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(AugmentReceipt::Panorama, made, stations)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(AugmentReceipt, made_from, panoramas)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(WordsReceipt, made_from, panoramas, counts_key)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(FileReceipt, made_from, key, parts)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RefinementReport, id, shift_m, turn_deg, residual_before_px,
                                   residual_after_px, num_tracks, is_flagged)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RefinedPose, report, is_moved, geodetic, enu_from_pano)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PartFile, num_bytes, sha256)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(TileReceipt, made_from, key, parts, num_landmarks, tile, images,
                                   refined)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(AssembleReceipt::Part, path, file, content)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(AssembleReceipt, made_from, parts, manifest)

namespace {

std::string ReadText(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (file) text << file.rdbuf();
  return text.str();
}

// A receipt of another release may lack a member: no receipt, then.
template <typename Receipt>
std::optional<Receipt> Parse(const std::string& text) {
  try {
    return Json::parse(text).get<Receipt>();
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

}  // namespace

template <typename Receipt>
void WriteReceipt(const WorkFolder& work, Stage stage, const std::string& unit,
                  const Receipt& receipt) {
  WriteIfChanged(work.receipt(stage, unit), Json(receipt).dump(1) + "\n");
}

template <typename Receipt>
std::optional<Receipt> FindReceipt(const WorkFolder& work, Stage stage, const std::string& unit) {
  return Parse<Receipt>(ReadText(work.receipt(stage, unit)));
}

template <typename Receipt>
Receipt ReadReceipt(const WorkFolder& work, Stage stage, const std::string& unit,
                    MadeFrom* made_from) {
  const std::string text = ReadText(work.receipt(stage, unit));
  auto receipt = Parse<Receipt>(text);
  if (!receipt) {
    throw Error(ErrorCode::kTryAgain, work.receipt(stage, unit).string() +
                                          ": not there or not of this release; run: "
                                          "panofix-builder " +
                                          StageCommand(stage, unit));
  }
  if (made_from != nullptr)
    (*made_from)[std::string(StageName(stage)) + "/" + unit] = Sha256Hex(text);
  return std::move(*receipt);
}

std::optional<UnitReport> FindReport(const WorkFolder& work, Stage stage, const std::string& unit) {
  return UnitReport::Parse(ReadText(work.report(stage, unit)));
}

std::string ReceiptSha256(const WorkFolder& work, Stage stage, const std::string& unit) {
  const std::string text = ReadText(work.receipt(stage, unit));
  return text.empty() ? "" : Sha256Hex(text);
}

std::string FormatTile(const TileReceipt& tile) {
  TileReceipt result = tile;
  result.made_from.clear();
  return Json(result).dump(1) + "\n";
}

std::optional<TileReceipt> ParseTile(const std::string& text) { return Parse<TileReceipt>(text); }

#define PANOFIX_RECEIPT(Receipt)                                                             \
  template void WriteReceipt(const WorkFolder&, Stage, const std::string&, const Receipt&);  \
  template std::optional<Receipt> FindReceipt(const WorkFolder&, Stage, const std::string&); \
  template Receipt ReadReceipt(const WorkFolder&, Stage, const std::string&, MadeFrom*);
PANOFIX_RECEIPT(ExtractReceipt)
PANOFIX_RECEIPT(AugmentReceipt)
PANOFIX_RECEIPT(WordsReceipt)
PANOFIX_RECEIPT(FileReceipt)
PANOFIX_RECEIPT(TileReceipt)
PANOFIX_RECEIPT(AssembleReceipt)
#undef PANOFIX_RECEIPT

}  // namespace panofix
