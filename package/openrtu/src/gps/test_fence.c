/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "gps/fence.h"

#define DEGREE 10000000

static struct gps_fence polygon(uint32_t count, const int32_t (*degrees)[2])
{
	struct gps_fence fence = {.corner_count = count};

	for (uint32_t i = 0; i < count; i++)
		fence.corners[i] = (struct gps_place){degrees[i][0] * DEGREE, degrees[i][1] * DEGREE};
	return fence;
}

static bool holds(const struct gps_fence *fence, double latitude, double longitude)
{
	return gps_fence_holds(
	    fence, (struct gps_place){(int32_t)(latitude * DEGREE), (int32_t)(longitude * DEGREE)});
}

static void test_a_circle(void **state)
{
	const struct gps_fence fence = {.centre = {522190650, 210108517}, .radius_m = 1000};

	(void)state;
	assert_null(gps_fence_fault(&fence));
	assert_true(holds(&fence, 52.219065, 21.0108517));
	assert_true(holds(&fence, 52.228, 21.0108517));   /* 994 m */
	assert_false(holds(&fence, 52.2281, 21.0108517)); /* 1 005 m */
}

static void test_a_circle_across_the_antimeridian_and_at_a_pole(void **state)
{
	const struct gps_fence fiji = {.centre = {-17 * DEGREE, 1799990000}, .radius_m = 50000},
			       pole = {.centre = {90 * DEGREE, 0}, .radius_m = 200000};

	(void)state;
	assert_true(holds(&fiji, -17, -179.6));
	assert_false(holds(&fiji, -17, -179.5));
	assert_true(holds(&pole, 89, 123));
	assert_false(holds(&pole, 88, 0));
}

static void test_a_polygon(void **state)
{
	static const int32_t corners[][2] = {{0, 0}, {0, 10}, {10, 10}, {5, 5}, {10, 0}};
	const struct gps_fence fence = polygon(5, corners);

	(void)state;
	assert_null(gps_fence_fault(&fence));
	assert_true(holds(&fence, 4, 5));
	assert_true(holds(&fence, 9, 9.5));
	assert_false(holds(&fence, 7, 5)); /* in the notch */
	assert_false(holds(&fence, -1, 5));
	assert_false(holds(&fence, 4, 10.0001));
	assert_false(holds(&fence, 4, -170));
}

static void test_a_polygon_across_the_antimeridian(void **state)
{
	static const int32_t corners[][2] = {{-10, 170}, {-10, -170}, {10, -170}, {10, 170}};

	(void)state;
	for (uint32_t first = 0; first < 4; first++) { /* whichever corner is the first */
		struct gps_fence fence = polygon(4, corners);

		for (uint32_t i = 0; i < 4; i++)
			fence.corners[i] = (struct gps_place){corners[(first + i) % 4][0] * DEGREE,
							      corners[(first + i) % 4][1] * DEGREE};
		assert_null(gps_fence_fault(&fence));
		assert_true(holds(&fence, 0, 175));
		assert_true(holds(&fence, 0, -175));
		assert_true(holds(&fence, 0, 180));
		assert_true(holds(&fence, 0, -180));
		assert_false(holds(&fence, 0, 165));
		assert_false(holds(&fence, 0, -165));
		assert_false(holds(&fence, 0, 0));
	}
}

static void test_the_greatest_polygon(void **state)
{
	static const int32_t corners[][2] = {{-90, -180}, {-90, 0}, {-90, 180},
					     {90, 180},   {90, 0},  {90, -180}};
	const struct gps_fence fence = polygon(6, corners);

	(void)state;
	assert_null(gps_fence_fault(&fence));
}

static void test_faults(void **state)
{
	static const int32_t ring[][2] = {{60, 0}, {60, 120}, {60, -120}},
			     beyond[][2] = {{0, 0}, {91, 0}, {0, 10}};
	struct gps_fence fence = {.radius_m = 0};

	(void)state;
	assert_non_null(gps_fence_fault(&fence));
	fence.radius_m = GPS_FENCE_RADIUS_MAX_M + 1;
	assert_non_null(gps_fence_fault(&fence));
	fence = (struct gps_fence){.centre = {900000001, 0}, .radius_m = 1};
	assert_non_null(gps_fence_fault(&fence));
	fence = polygon(3, ring);
	assert_string_equal(gps_fence_fault(&fence), "it encloses a pole");
	fence = polygon(3, beyond);
	assert_non_null(gps_fence_fault(&fence));
	fence.corner_count = 2;
	assert_non_null(gps_fence_fault(&fence));
	fence.corner_count = GPS_FENCE_CORNERS_MAX + 1;
	assert_non_null(gps_fence_fault(&fence));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_circle),
	    cmocka_unit_test(test_a_circle_across_the_antimeridian_and_at_a_pole),
	    cmocka_unit_test(test_a_polygon),
	    cmocka_unit_test(test_a_polygon_across_the_antimeridian),
	    cmocka_unit_test(test_the_greatest_polygon),
	    cmocka_unit_test(test_faults),
	};
	return cmocka_run_group_tests_name("gps fence", tests, NULL, NULL);
}
