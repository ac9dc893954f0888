#pragma once
// Outcomes of work on outside bytes: a code that programs act on, a message that people act on.

#include <cassert>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

namespace panofix {

enum class ErrorCode {
  kOk,
  kInvalidArgument,     // an option or a call's value breaks its rule
  kNotFound,            // a file, id or dataset is not there
  kIo,                  // disk or network failed
  kBadData,             // bytes do not follow their format
  kTooLarge,            // a length exceeds its stated limit
  kUnsupportedVersion,  // a format newer than this program reads
  kChecksumMismatch,    // a file is not the one its manifest names
  kNoSpace,             // the disk is full
  kCancelled,           // the user asked to stop
  kTryAgain,            // what is missing, failed or busy may be there another time
  // Why a vehicle refuses a map.
  kUntrusted,    // no signature, one that does not verify, or by a key that is not trusted
  kKeyRevoked,   // signed by a key that was taken back
  kDowngrade,    // an older build than one seen before, or another of the same number
  kExpired,      // past the day that its signature states
  kMixedParts,   // a part is not the one that the signed manifest names
  kEndlessData,  // more bytes or time than were stated or allowed
  kIncomplete,   // a part is missing or cut short
  kWrongCamera,  // made for another camera
  kWrongMap,     // another map than the one this vehicle drives on
  kUnhealthy,    // it does not run here; the one before is back
  kInternal,     // a bug of ours
};

[[nodiscard]] const char* ErrorCodeName(ErrorCode code);

// Exit code of a program that ends with `code`, after sysexits.h: 0 done, 64 usage, 65 bad data,
// 66 no input, 70 internal, 74 input/output or disk full, 75 try again, 76 version, 77 not trusted,
// 80..88 the other reasons to refuse a map, in the order above, 130 interrupted.
[[nodiscard]] int ExitCode(ErrorCode code);

// Messages name the file, the fault and the mend: "pano.gsv: 3 bytes long; re-export the depth".
class [[nodiscard]] Status {
 public:
  Status() = default;
  Status(ErrorCode code, std::string message) : code_(code), message_(std::move(message)) {}
  [[nodiscard]] bool ok() const { return code_ == ErrorCode::kOk; }
  [[nodiscard]] ErrorCode code() const { return code_; }
  [[nodiscard]] const std::string& message() const { return message_; }

 private:
  ErrorCode code_ = ErrorCode::kOk;
  std::string message_;
};

// Either a T or the Status that says why not. Reading the value of a failed result is a caller's
// bug and throws std::logic_error.
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::move(value)) {}        // NOLINT: implicit on purpose
  Result(Status status) : state_(std::move(status)) {  // NOLINT: implicit on purpose
    if (std::get<Status>(state_).ok()) throw std::logic_error("Result built from an ok status");
  }
  [[nodiscard]] bool ok() const { return std::holds_alternative<T>(state_); }
  [[nodiscard]] Status status() const { return ok() ? Status() : std::get<Status>(state_); }
  [[nodiscard]] const T& value() const& {
    Require();
    return std::get<T>(state_);
  }
  [[nodiscard]] T& value() & {
    Require();
    return std::get<T>(state_);
  }
  [[nodiscard]] T&& value() && {
    Require();
    return std::get<T>(std::move(state_));
  }
  [[nodiscard]] const T& operator*() const& { return value(); }
  [[nodiscard]] T& operator*() & { return value(); }
  [[nodiscard]] const T* operator->() const { return &value(); }
  [[nodiscard]] T* operator->() { return &value(); }

 private:
  void Require() const {
    if (!ok())
      throw std::logic_error("value of a failed result: " + std::get<Status>(state_).message());
  }
  std::variant<T, Status> state_;
};

// What the builder throws on a bad file, disk or network; caught once, in main.
class Error : public std::runtime_error {
 public:
  Error(ErrorCode code, const std::string& message) : std::runtime_error(message), code_(code) {}
  explicit Error(const Status& status) : Error(status.code(), status.message()) {}
  [[nodiscard]] ErrorCode code() const { return code_; }

 private:
  ErrorCode code_;
};

// The value, or an Error thrown: the builder's bridge from Result.
template <typename T>
T ValueOrThrow(Result<T> result) {
  if (!result.ok()) throw Error(result.status());
  return std::move(result).value();
}
inline void ThrowIfError(const Status& status) {
  if (!status.ok()) throw Error(status);
}

}  // namespace panofix
