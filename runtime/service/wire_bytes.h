#pragma once
// One payload of the wire, kept alive without copying by whoever holds it.

#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <vector>

namespace panofix {

// Copies share the bytes, which nobody changes.
struct WireBytes {
  std::shared_ptr<const void> owner;
  std::span<const std::uint8_t> bytes;

  // A copy whose first byte is aligned for any scalar (operator new guarantees it).
  [[nodiscard]] static WireBytes Copy(std::span<const std::uint8_t> source) {
    auto storage = std::make_shared<std::vector<std::uint8_t>>(source.begin(), source.end());
    const std::span<const std::uint8_t> bytes(*storage);
    return {std::move(storage), bytes};
  }
  // libzmq hands out small messages at odd addresses; FlatBuffers reads doubles in place.
  [[nodiscard]] WireBytes Aligned() const {
    return reinterpret_cast<std::uintptr_t>(bytes.data()) % alignof(double) == 0 ? *this
                                                                                 : Copy(bytes);
  }
};

}  // namespace panofix
