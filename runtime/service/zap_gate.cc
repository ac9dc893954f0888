#include "runtime/service/zap_gate.h"

#include "common/base/log.h"

namespace panofix {
namespace {

constexpr std::size_t kKeyBytes = 32, kKeyChars = 40;

std::string ToPrintable(const std::string& key) {
  char text[kKeyChars + 1] = "";
  zmq_z85_encode(text, reinterpret_cast<const std::uint8_t*>(key.data()), key.size());
  return text;
}

}  // namespace

ZapGate::ZapGate(zmq::context_t& context, const std::vector<std::string>& allowed)
    : socket_(context, zmq::socket_type::rep) {
  for (const std::string& key : allowed) {
    std::string binary(kKeyBytes, '\0');
    if (zmq_z85_decode(reinterpret_cast<std::uint8_t*>(binary.data()), key.c_str()) != nullptr) {
      allowed_.insert(binary);
    }
  }
  socket_.set(zmq::sockopt::linger, 0);
  socket_.bind("inproc://zeromq.zap.01");
  thread_ = std::thread([this] { Run(); });
}

ZapGate::~ZapGate() {
  stop_ = true;
  thread_.join();
}

void ZapGate::Run() {
  constexpr std::chrono::milliseconds kPoll(50);  // bounds the time to a stop
  while (!stop_) {
    try {
      zmq::pollitem_t item{socket_.handle(), 0, ZMQ_POLLIN, 0};
      if (zmq::poll(&item, 1, kPoll) == 0) continue;
      std::vector<std::string> request;
      zmq::message_t part;
      do {
        if (!socket_.recv(part)) break;
        request.push_back(part.to_string());
      } while (part.more());
      Answer(request);
    } catch (const zmq::error_t& error) {
      if (error.num() != EINTR) return;  // the context ends
    }
  }
}

// version, request id, domain, address, identity, mechanism, key
void ZapGate::Answer(const std::vector<std::string>& request) {
  constexpr std::size_t kParts = 7, kId = 1, kAddress = 3, kMechanism = 5, kKey = 6;
  const bool is_curve = request.size() == kParts && request[kMechanism] == "CURVE" &&
                        request[kKey].size() == kKeyBytes;
  const bool is_allowed = is_curve && allowed_.contains(request[kKey]);
  if (!is_allowed) {
    ++num_denied_;
    if (is_curve) {
      log_.Warn(request[kAddress] + " turned away: its key " + ToPrintable(request[kKey]) +
                " is not among those that may connect");
    }
  }
  const std::string id = request.size() > kId ? request[kId] : "";
  const char* code = is_allowed ? "200" : "400";
  const std::vector<std::string> reply{"1.0", id, code, "", "", ""};
  for (std::size_t i = 0; i < reply.size(); ++i) {
    const auto flags = i + 1 < reply.size() ? zmq::send_flags::sndmore : zmq::send_flags::none;
    socket_.send(zmq::buffer(reply[i]), flags);
  }
}

}  // namespace panofix
