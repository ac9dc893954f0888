#pragma once
// Fills the plan with buildings, street surfaces and props.

#include "tests/town/layout.h"
#include "tests/town/world.h"

namespace panofix::town {

// The day the panoramas were taken, or the day of the drive.
enum class Day { kMap, kDrive };

[[nodiscard]] World GenerateWorld(const TownOptions& options, const StreetGrid& grid, Day day);

// Rows of buildings along every block and around the town.
void AddBuildings(World& world, const TownOptions& options, const StreetGrid& grid, Day day);
// Road, markings, manholes, pavements and kerbs; the ground planes of the depth maps.
void AddStreets(World& world, const TownOptions& options, const StreetGrid& grid);
// Trees, furniture, cars and people.
void AddProps(World& world, const TownOptions& options, const StreetGrid& grid, Day day);

}  // namespace panofix::town
