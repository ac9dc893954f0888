// The Python of the README, as it stands there, against the real service.
#include <gtest/gtest.h>
#include <signal.h>

#include <fstream>
#include <regex>
#include <sstream>
#include <thread>

#include "common/drive/drive.h"
#include "tests/e2e/data_set.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;
const std::string kPython = "/usr/bin/python3";  // Debian's, which has the packages
constexpr double kPatience_s = 60 * PANOFIX_SLOWDOWN;

// The code after <!-- NAME -->, its addresses replaced.
std::string CodeOf(const std::string& name, const std::string& frames, const std::string& poses) {
  std::ifstream in(fs::path(PANOFIX_SOURCE_DIR) / "README.md");
  std::stringstream text;
  text << in.rdbuf();
  const std::string begin = "<!-- " + name + " -->\n```python\n";
  const std::size_t at = text.str().find(begin);
  if (at == std::string::npos) {
    ADD_FAILURE() << "README.md has no " << name;
    return {};
  }
  std::string code = text.str().substr(at + begin.size());
  code = code.substr(0, code.find("```"));
  code = std::regex_replace(code, std::regex("tcp://127.0.0.1:5601"), frames);
  return std::regex_replace(code, std::regex("tcp://127.0.0.1:5602"), poses);
}

TEST(Interop, ReadmesPythonPublishesAndSubscribes) {
  if (RunProgram({kPython, "-c", "import zmq, flatbuffers"}).exit_code != 0) {
    GTEST_SKIP() << "needs python3-zmq and python3-flatbuffers";
  }
  const TownData data(EasyTown());
  const fs::path root = data.root(), schemas = fs::path(PANOFIX_SOURCE_DIR) / "schemas";
  ASSERT_EQ(data.Build(data.panoramas(), root / "map").exit_code, 0);
  std::vector<std::string> flatc{"/usr/bin/flatc",         "--python", "-o",
                                 (root / "wire").string(), "-I",       schemas.string()};
  for (const char* folder : {"panofix", "foxglove"}) {
    for (const auto& entry : fs::directory_iterator(schemas / folder)) {
      flatc.push_back(entry.path().string());
    }
  }
  ASSERT_EQ(RunProgram(flatc).exit_code, 0);
  const std::string frames = "ipc://" + (root / "f").string(),
                    poses = "ipc://" + (root / "p").string();
  const auto script = [&](const std::string& name) {
    std::string code = CodeOf(name, frames, poses);
    code = std::regex_replace(code, std::regex("\"wire\""), "\"" + (root / "wire").string() + "\"");
    std::ofstream(root / (name + ".py")) << code;
    return (root / (name + ".py")).string();
  };
  Process serve(RuntimeCommand(
      {"serve", "--bundle", (root / "map").string(), "--frames", frames, "--poses", poses}));
  Process subscriber({kPython, script("python-subscriber")});
  std::vector<std::string> camera{kPython, script("python-publisher")};
  const Drive drive = ReadDrive(data.drive()).value();
  for (const DriveFrame& frame : drive.frames) {
    camera.push_back(frame.image.string());
  }
  Process publisher(camera);
  // Lines of four numbers: time, latitude, longitude, heading.
  const std::regex fix(R"((^|\n)\d+ -?\d+\.\d+ -?\d+\.\d+ \d+(\.\d+)?\n)");
  bool found = false;
  for (double waited_s = 0; !found && waited_s < kPatience_s; waited_s += 0.1) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    found = std::regex_search(subscriber.Output(), fix);
  }
  EXPECT_TRUE(found) << subscriber.Output() << subscriber.Errors() << publisher.Errors()
                     << serve.Errors();
}

}  // namespace
}  // namespace panofix::e2e
