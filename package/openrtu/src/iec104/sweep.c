/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Many points, as many ASDUs as it takes, resumed whenever k and the connection allow. */
#include "iec104/carrier.h"
#include "iec104/station_parts.h"
#include "map/time_ns.h"
#include "map/type.h"

#define RETRY_NS NS_PER_MS

void iec104_retry_soon(struct iec104_connection *connection, int64_t now_ns)
{
	connection->retry_ns = now_ns + RETRY_NS;
}

/*
 * An owner without a heartbeat for a moment is invalid to every reader, also when rtud, which looks every now and
 * then, sees nothing and puts no event.
 */
bool iec104_read_point(const struct iec104_station *station, struct iec104_connection *connection,
		       uint32_t point, bool totals, struct map_sample samples[IEC104_SAMPLES])
{
	const struct map_point *object = iec104_point(station, point);
	uint32_t owner = map_owner(station->map, point);

	if (object->type == MAP_COUNTER && (totals || object->freeze_s != 0))
		return map_total_read(station->map, point, samples);

	if (!(iec104_is_position(station, point) ? iec104_read_position(station, point, samples)
						 : map_read(station->map, point, samples)))
		return false;
	if ((samples[0].quality & MAP_INVALID) && !map_alive(station->map, owner))
		iec104_note_silent(station, connection, owner);
	return true;
}

bool iec104_is_tellable(const struct iec104_station *station, uint32_t point, const struct map_sample *sample)
{
	return !(iec104_point(station, point)->flags & MAP_POINT_NO_QUALITY) || sample->quality == MAP_GOOD;
}

/* Value and quality. M_ME_ND_1 has no quality: the last octet of the element. */
static size_t encode(const struct map_point *object, const struct map_sample *sample, uint8_t *element)
{
	size_t size = iec104_element_encode(element, (enum map_type)object->type, sample);

	return object->flags & MAP_POINT_NO_QUALITY ? size - 1 : size;
}

static bool add_position(const struct iec104_station *station, struct iec104_builder *builder,
			 const struct map_event *event, const struct map_sample *samples)
{
	const struct map_clock clock = map_clock_read(station->map);
	struct iec104_geoposition position = iec104_position_of(samples);
	uint8_t element[IEC104_GEOPOSITION_SIZE];

	position.wall_ns = map_event_wall_ns(event, clock);
	position.time_invalid = !map_event_time_is_set(event, clock);
	iec104_geoposition_encode(element, &position, &station->config->settings.zone);
	return iec104_asdu_add(builder, iec104_point(station, event->point)->ioa, element, sizeof(element));
}

bool iec104_add_event(const struct iec104_station *station, struct iec104_builder *builder,
		      const struct map_event *event, const struct map_sample *samples)
{
	const struct map_point *object = iec104_point(station, event->point);
	struct map_clock clock = map_clock_read(station->map);
	uint8_t element[IEC104_ELEMENT_MAX];
	size_t size;

	if (iec104_is_position(station, event->point))
		return add_position(station, builder, event, samples);
	size = encode(object, &samples[0], element);
	if (!(object->flags & MAP_POINT_NO_QUALITY)) { /* which has no time tag either */
		iec104_time56_encode(element + size, map_event_wall_ns(event, clock),
				     !map_event_time_is_set(event, clock), &station->config->settings.zone);
		size += IEC104_TIME56_SIZE;
	}
	return iec104_asdu_add(builder, object->ioa, element, size);
}

bool iec104_add_samples(const struct iec104_station *station, struct iec104_builder *builder, uint32_t point,
			const struct map_sample samples[IEC104_SAMPLES], bool tagged)
{
	const struct map_point *object = iec104_point(station, point);
	uint8_t element[IEC104_ELEMENT_MAX];
	size_t size;

	if (tagged || iec104_is_position(station, point)) /* which has its time always */
		return iec104_add_event(station, builder,
					&(struct map_event){.point = point, .sample = samples[0]}, samples);
	size = encode(object, &samples[0], element);
	return iec104_asdu_add(builder, object->ioa, element, size);
}

void iec104_send(struct iec104_connection *connection, const struct iec104_builder *builder, int64_t now_ns)
{
	iec104_session_send(&connection->session, builder->bytes, builder->size, now_ns);
}

uint8_t iec104_type_of(const struct iec104_station *station, uint32_t point, bool tagged)
{
	return iec104_is_position(station, point) ? station->settings->position_type
						  : iec104_monitor_type(iec104_point(station, point), tagged);
}

/* What has one of these is one ASDU's: a type without time tag, all of which are below 32, or 0 of positions. */
static unsigned kind_of(const struct iec104_station *station, uint32_t point)
{
	return iec104_is_position(station, point) ? 0 : iec104_type_of(station, point, false);
}

static void enter_device(const struct iec104_station *station, const struct iec104_connection *connection,
			 struct iec104_sweep *sweep, uint32_t index, iec104_wanted *wanted)
{
	const struct map_set *device;

	while (index < sweep->end_device && sweep->ca != 0 && station->config->sets[index].ca != sweep->ca)
		index++;
	sweep->device = index;
	sweep->types = 0;
	if (index == sweep->end_device)
		return;
	device = &station->config->sets[index];
	sweep->next = device->first_point;
	for (uint32_t i = 0; i < device->point_count; i++)
		if (wanted(station, connection, device->first_point + i))
			sweep->types |= 1u << kind_of(station, device->first_point + i);
}

void iec104_begin_sweep_of_station(const struct iec104_station *station,
				   const struct iec104_connection *connection, struct iec104_sweep *sweep,
				   uint32_t first, iec104_wanted *wanted)
{
	sweep->ca = station->config->sets[first].ca;
	sweep->end_device = iec104_station_end(station, first);
	enter_device(station, connection, sweep, first, wanted);
}

void iec104_begin_sweep_of_all(const struct iec104_station *station,
			       const struct iec104_connection *connection, struct iec104_sweep *sweep,
			       iec104_wanted *wanted)
{
	sweep->ca = 0;
	sweep->end_device = station->config->set_count;
	enter_device(station, connection, sweep, 0, wanted);
}

/* Moves to the next wanted point and returns it; MAP_NONE: there is none. */
static uint32_t find_point(const struct iec104_station *station, const struct iec104_connection *connection,
			   struct iec104_sweep *sweep, iec104_wanted *wanted)
{
	while (sweep->device < sweep->end_device) {
		const struct map_set *device = &station->config->sets[sweep->device];

		for (; sweep->types != 0; sweep->types &= sweep->types - 1) {
			unsigned kind = (unsigned)__builtin_ctz(sweep->types);

			for (; sweep->next < device->first_point + device->point_count; sweep->next++)
				if (kind_of(station, sweep->next) == kind &&
				    wanted(station, connection, sweep->next))
					return sweep->next;
			sweep->next = device->first_point;
		}
		enter_device(station, connection, sweep, sweep->device + 1, wanted);
	}
	return MAP_NONE;
}

/* The next point is the same station's, of the same type, at the next address. */
static bool neighbour_follows(const struct iec104_station *station,
			      const struct iec104_connection *connection, uint32_t point,
			      iec104_wanted *wanted)
{
	const struct map_point *here = iec104_point(station, point), *there = here + 1;

	return point + 1 < station->config->point_count && there->set == here->set &&
	       kind_of(station, point + 1) == kind_of(station, point) && there->ioa == here->ioa + 1 &&
	       wanted(station, connection, point + 1);
}

/* IEC 60870-5-101, 7.3.1: only measured values may be cyclic, integrated totals only spontaneous. */
static uint8_t periodic_cause(const struct map_point *object)
{
	switch (map_types[iec104_carrier_of(object)].class) {
	case MAP_CLASS_MEASURED:
		return IEC104_CYCLIC;
	case MAP_CLASS_TOTAL:
		return IEC104_SPONTANEOUS;
	case MAP_CLASS_STATE:
	case MAP_CLASS_POSITION:
	case MAP_CLASS_PATTERN:
		break;
	}
	return IEC104_BACKGROUND;
}

void iec104_begin_asdu(const struct iec104_station *station, struct iec104_builder *builder, uint32_t point,
		       const struct iec104_manner *manner, bool sequence)
{
	const struct map_point *object = iec104_point(station, point);

	iec104_asdu_begin(
	    builder, &(struct iec104_asdu){
			 .type = iec104_type_of(station, point, manner->tagged),
			 .sequence = sequence,
			 .cause = manner->cause == IEC104_CYCLIC ? periodic_cause(object) : manner->cause,
			 .test = manner->test,
			 .originator = manner->originator,
			 .ca = iec104_device(station, point)->ca,
		     });
}

/*
 * Fills the ASDU with points of one station and type from the sweep on. Neighbours go into an ASDU with
 * SQ = 1, so one without it ends before them. False: a point could not be read just now.
 */
static bool fill_asdu(const struct iec104_station *station, struct iec104_connection *connection,
		      struct iec104_builder *builder, struct iec104_sweep *sweep,
		      const struct iec104_manner *manner)
{
	uint32_t device = sweep->device, point = sweep->next;
	unsigned kind = kind_of(station, point);
	bool sequence = !manner->tagged && neighbour_follows(station, connection, point, manner->wanted);
	const bool as_read = !manner->invalid && !manner->current;

	iec104_begin_asdu(station, builder, point, manner, sequence);
	do {
		struct map_sample samples[IEC104_SAMPLES];

		if (!iec104_read_point(station, connection, point, manner->totals, samples))
			return false;
		if ((as_read || iec104_adapt(station, connection, point, manner, samples)) &&
		    iec104_is_tellable(station, point, &samples[0]) &&
		    !iec104_add_samples(station, builder, point, samples, manner->tagged))
			return true;
		sweep->next++;
		point = find_point(station, connection, sweep, manner->wanted);
	} while (
	    point != MAP_NONE && sweep->device == device && kind_of(station, point) == kind &&
	    (manner->tagged || sequence || !neighbour_follows(station, connection, point, manner->wanted)));
	return true;
}

enum iec104_progress iec104_send_points(const struct iec104_station *station,
					struct iec104_connection *connection, struct iec104_sweep *sweep,
					const struct iec104_manner *manner, int64_t now_ns)
{
	struct iec104_sweep ahead;
	struct iec104_builder builder;
	bool readable;

	if (find_point(station, connection, sweep, manner->wanted) == MAP_NONE)
		return IEC104_SWEEP_DONE;
	ahead = *sweep;
	readable = fill_asdu(station, connection, &builder, &ahead, manner);
	/* An event that waits now may be older than what was read: it goes first, then all is read again. */
	if (!manner->invalid && iec104_event_waits(station, connection))
		return IEC104_SWEEP_GOES_ON;
	*sweep = ahead;
	if (iec104_asdu_count(&builder) > 0)
		iec104_send(connection, &builder, now_ns);
	if (readable)
		return IEC104_SWEEP_GOES_ON;
	iec104_retry_soon(connection, now_ns);
	return IEC104_SWEEP_TRY_LATER;
}
