#pragma once
// What stands on the street and no depth plane knows: cars, people, trees, furniture.

#include "common/base/rng.h"
#include "tests/town/world.h"

namespace panofix::town {

// Where a prop stands: on the ground, facing `forward` (unit, along the ground).
struct Stand {
  Eigen::Vector3d base, forward;
};

void AddCar(World& world, const Stand& stand, Rng rng);
void AddPerson(World& world, const Stand& stand, Rng rng);
// Trunk and branches follow `shape`; the leaves' colours and places follow `leaves`.
void AddTree(World& world, const Stand& stand, Rng shape, Rng leaves);
void AddLampPost(World& world, const Stand& stand, Rng rng);
void AddBollard(World& world, const Stand& stand, Rng rng);
// A traffic or street sign on a pole.
void AddStreetSign(World& world, const Stand& stand, Rng rng);
void AddBin(World& world, const Stand& stand, Rng rng);
// A round column covered with posters.
void AddPosterColumn(World& world, const Stand& stand, Rng shape, Rng daily);

}  // namespace panofix::town
