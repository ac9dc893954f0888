// A recording of a run, from outside: reading and replaying it ends with records or a reason.

#include <unistd.h>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <span>

#include "runtime/mcap/mcap_reader.h"
#include "runtime/service/replay.h"
#include "tests/fuzz/fuzz_target.h"

namespace panofix {
namespace {

std::filesystem::path Scratch(const char* name) {
  return std::filesystem::temp_directory_path() /
         ("panofix_fuzz_" + std::to_string(::getpid()) + name);
}

std::string SampleRecording() {
  const auto path = Scratch("_sample.mcap");
  std::filesystem::remove(path);
  {
    McapWriter writer = ValueOrThrow(McapWriter::Create(path));
    for (const char* topic : {"panofix.frame.v1", "panofix.camera.v1", "panofix.pose.v1"}) {
      const auto id = ValueOrThrow(writer.AddChannel(topic, {"S", "flatbuffer", {}}));
      ThrowIfError(writer.WriteMetadata("panofix.options", {{"add", "a,b,,"}, {"seed", "1"}}));
      ThrowIfError(writer.WriteMetadata("panofix.deadline", {{"step", "3"}}));
      ThrowIfError(writer.WriteMessage(id, 1, 2, std::vector<std::uint8_t>(40, 7)));
    }
    ThrowIfError(writer.Finish());
  }
  std::ifstream in(path, std::ios::binary);
  std::string bytes((std::istreambuf_iterator<char>(in)), {});
  std::filesystem::remove(path);
  return bytes;
}

}  // namespace

FuzzCorpus SeedCorpus() {
  FuzzCorpus corpus;
  corpus.inputs = {SampleRecording(), SampleRecording().substr(0, 60)};
  corpus.words = {"\xff\xff\xff\xff",   std::string(8, '\xff'), "\x0f",       "\x02", "\x05",
                  std::string(4, '\0'), "panofix.frame.v1",     "panofix.map"};
  return corpus;
}

}  // namespace panofix

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace panofix;
  static const auto path = Scratch(".mcap");
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  std::size_t num_bytes = 0;
  if (auto reader = McapReader::Open(path); reader.ok()) {
    while (true) {
      const auto record = reader->Next();
      if (!record.ok() && record.status().message().empty()) std::abort();
      if (!record.ok() || !record->has_value()) break;
      num_bytes += (*record)->data.size();
    }
  }
  if (num_bytes > size) std::abort();  // no byte is told twice
  const auto report = Replay(path, [](const std::string&, const Camera&, const LocalizerOptions&) {
    return Result<std::unique_ptr<FrameEngine>>(Status(ErrorCode::kNotFound, "no map here"));
  });
  if (report.ok() && report->num_frames > 0) std::abort();  // none has a map to be answered from
  std::filesystem::remove(path);
  return 0;
}
