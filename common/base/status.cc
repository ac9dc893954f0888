#include "common/base/status.h"

namespace panofix {

const char* ErrorCodeName(ErrorCode code) {
  switch (code) {
    case ErrorCode::kOk:
      return "ok";
    case ErrorCode::kInvalidArgument:
      return "invalid argument";
    case ErrorCode::kNotFound:
      return "not found";
    case ErrorCode::kIo:
      return "input/output error";
    case ErrorCode::kBadData:
      return "bad data";
    case ErrorCode::kTooLarge:
      return "too large";
    case ErrorCode::kUnsupportedVersion:
      return "unsupported version";
    case ErrorCode::kChecksumMismatch:
      return "checksum mismatch";
    case ErrorCode::kNoSpace:
      return "disk full";
    case ErrorCode::kCancelled:
      return "interrupted";
    case ErrorCode::kTryAgain:
      return "try again";
    case ErrorCode::kUntrusted:
      return "not trusted";
    case ErrorCode::kKeyRevoked:
      return "key revoked";
    case ErrorCode::kDowngrade:
      return "downgrade";
    case ErrorCode::kExpired:
      return "expired";
    case ErrorCode::kMixedParts:
      return "mixed parts";
    case ErrorCode::kEndlessData:
      return "endless data";
    case ErrorCode::kIncomplete:
      return "incomplete";
    case ErrorCode::kWrongCamera:
      return "wrong camera";
    case ErrorCode::kWrongMap:
      return "wrong map";
    case ErrorCode::kUnhealthy:
      return "unhealthy";
    case ErrorCode::kInternal:
      return "internal error";
  }
  return "unknown";
}

int ExitCode(ErrorCode code) {
  switch (code) {
    case ErrorCode::kOk:
      return 0;
    case ErrorCode::kInvalidArgument:
      return 64;
    case ErrorCode::kBadData:
    case ErrorCode::kTooLarge:
    case ErrorCode::kChecksumMismatch:
      return 65;
    case ErrorCode::kNotFound:
      return 66;
    case ErrorCode::kInternal:
      return 70;
    case ErrorCode::kIo:
    case ErrorCode::kNoSpace:
      return 74;
    case ErrorCode::kTryAgain:
      return 75;
    case ErrorCode::kUnsupportedVersion:
      return 76;
    case ErrorCode::kUntrusted:
      return 77;
    case ErrorCode::kKeyRevoked:
      return 80;
    case ErrorCode::kDowngrade:
      return 81;
    case ErrorCode::kExpired:
      return 82;
    case ErrorCode::kMixedParts:
      return 83;
    case ErrorCode::kEndlessData:
      return 84;
    case ErrorCode::kIncomplete:
      return 85;
    case ErrorCode::kWrongCamera:
      return 86;
    case ErrorCode::kWrongMap:
      return 87;
    case ErrorCode::kUnhealthy:
      return 88;
    case ErrorCode::kCancelled:
      return 130;
  }
  return 70;
}

}  // namespace panofix
