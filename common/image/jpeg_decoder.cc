#include "common/image/jpeg_decoder.h"

#include <csetjmp>
#include <cstddef>
#include <cstdio>
// jpeglib.h wants size_t and FILE before it.
#include <jerror.h>
#include <jpeglib.h>

namespace panofix {
namespace {

// libjpeg reports a fatal fault by a call that must not return; longjmp is its documented way out.
// So what runs between setjmp and longjmp owns nothing that needs a destructor.
struct ErrorManager {
  jpeg_error_mgr base;  // first: libjpeg hands back a pointer to it
  std::jmp_buf escape;
  bool is_damaged;
};

void OnFatal(j_common_ptr decoder) {
  std::longjmp(reinterpret_cast<ErrorManager*>(decoder->err)->escape, 1);
}

// Warnings after which libjpeg invents data; others, such as stray bytes between segments, lose
// nothing.
void OnMessage(j_common_ptr decoder, int level) {
  if (level >= 0) return;  // a trace
  switch (decoder->err->msg_code) {
    case JWRN_HIT_MARKER:
    case JWRN_HUFF_BAD_CODE:
    case JWRN_JPEG_EOF:
    case JWRN_MUST_RESYNC:
      reinterpret_cast<ErrorManager*>(decoder->err)->is_damaged = true;
      break;
    default:
      break;
  }
}

void OnOutput(j_common_ptr) {}

// False where the decoder gave up or the picture is of another size than `pixels` has room for.
bool DecodeInto(std::span<const std::uint8_t> bytes, int reduction, GrayImage* image) {
  jpeg_decompress_struct decoder{};
  ErrorManager errors{};
  decoder.err = jpeg_std_error(&errors.base);
  errors.base.error_exit = OnFatal;
  errors.base.emit_message = OnMessage;
  errors.base.output_message = OnOutput;
  if (setjmp(errors.escape) != 0) {
    jpeg_destroy_decompress(&decoder);
    return false;
  }
  jpeg_create_decompress(&decoder);
  jpeg_mem_src(&decoder, bytes.data(), bytes.size());
  jpeg_read_header(&decoder, TRUE);
  decoder.out_color_space = JCS_GRAYSCALE;
  decoder.scale_num = 1;
  decoder.scale_denom = static_cast<unsigned int>(reduction);
  jpeg_start_decompress(&decoder);
  const auto width = static_cast<std::size_t>(image->width_px);
  if (decoder.output_width == width && decoder.output_components == 1 &&
      decoder.output_height == static_cast<std::size_t>(image->height_px)) {
    while (decoder.output_scanline < decoder.output_height && !errors.is_damaged) {
      JSAMPROW row = image->pixels.data() + decoder.output_scanline * width;
      jpeg_read_scanlines(&decoder, &row, 1);
    }
  }
  const bool is_whole = decoder.output_scanline == decoder.output_height && !errors.is_damaged;
  jpeg_destroy_decompress(&decoder);
  return is_whole;
}

}  // namespace

Result<GrayImage> DecodeJpegGray(std::span<const std::uint8_t> bytes, ImageSize size,
                                 int reduction) {
  GrayImage image;
  image.width_px = (size.width_px + reduction - 1) / reduction;
  image.height_px = (size.height_px + reduction - 1) / reduction;
  image.pixels.resize(static_cast<std::size_t>(image.width_px) *
                      static_cast<std::size_t>(image.height_px));
  if (!DecodeInto(bytes, reduction, &image)) {
    return Status(ErrorCode::kBadData,
                  "JPEG is damaged or of a kind that is not read; copy it again or "
                  "export it as a baseline JPEG");
  }
  return image;
}

}  // namespace panofix
