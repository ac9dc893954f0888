#pragma once
// vocabulary.h5 of a bundle, which is also a vocabulary release that later builds reuse.

#include "common/io/hdf5_file.h"
#include "common/vocabulary/vocabulary.h"

namespace panofix {

// Trees and inverse document frequencies, checked. kBadData or kNotFound.
[[nodiscard]] Result<Vocabulary> ReadVocabulary(const Hdf5Reader& file);

}  // namespace panofix
