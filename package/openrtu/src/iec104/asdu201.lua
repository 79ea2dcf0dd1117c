-- SPDX-License-Identifier: GPL-3.0-or-later
-- Wireshark and tshark: the position of type 201 in IEC 60870-5-104 (docs/positioning.md).
--
--	tshark -X lua_script:asdu201.lua -o asdu201.type:201 -r capture.pcap -O iec60870_asdu,asdu201
--
-- Wireshark's own dissector knows no private types and offers no table for them, so this one reads after it.

local ELEMENT, HEADER, ADDRESS = 20, 6, 3

local position = Proto("asdu201", "IEC 60870-5-104 position")
position.prefs.type = Pref.uint("Type identification", 201, "136 to 255, as the station is configured")

local fixes = {
	[0] = "none", "autonomous", "differential", "precise", "RTK", "RTK, floating", "estimated", "typed", "simulated",
}
local f = position.fields
f.ioa = ProtoField.uint24("asdu201.ioa", "Information object address")
f.latitude = ProtoField.double("asdu201.latitude", "Latitude in degrees")
f.longitude = ProtoField.double("asdu201.longitude", "Longitude in degrees")
f.altitude = ProtoField.double("asdu201.altitude", "Altitude in metres")
f.fix = ProtoField.uint8("asdu201.fix", "Fix", base.DEC, fixes, 0x0f)
f.satellites = ProtoField.uint8("asdu201.satellites", "Satellites", base.DEC, nil, 0xf0)
f.invalid = ProtoField.bool("asdu201.invalid", "IV", 8, nil, 0x80)
f.not_topical = ProtoField.bool("asdu201.not_topical", "NT", 8, nil, 0x40)
f.substituted = ProtoField.bool("asdu201.substituted", "SB", 8, nil, 0x20)
f.blocked = ProtoField.bool("asdu201.blocked", "BL", 8, nil, 0x10)
f.overflow = ProtoField.bool("asdu201.overflow", "OV", 8, nil, 0x01)
f.time = ProtoField.string("asdu201.time", "Time")
f.time_invalid = ProtoField.bool("asdu201.time_invalid", "Time invalid", 8, nil, 0x80)
local wrong_size = ProtoExpert.new("asdu201.wrong_size", "The ASDU is not as long as its number of positions says",
	expert.group.MALFORMED, expert.severity.ERROR)
position.experts = { wrong_size }

local apdus = Field.new("iec60870_104.apdulen")
local types = Field.new("iec60870_asdu.typeid")

local function time_of(octets)
	local ms = octets(0, 2):le_uint()
	return string.format("20%02d-%02d-%02d %02d:%02d:%02d.%03d", octets(6, 1):bitfield(1, 7), octets(5, 1):bitfield(4, 4),
		octets(4, 1):bitfield(3, 5), octets(3, 1):bitfield(3, 5), octets(2, 1):bitfield(2, 6), math.floor(ms / 1000), ms % 1000)
end

local function element(octets, ioa, tree)
	local latitude, longitude = octets(0, 4):le_int() / 1e7, octets(4, 4):le_int() / 1e7
	local branch = tree:add(position, octets, string.format("Position: IOA %d, %.7f, %.7f", ioa, latitude, longitude))
	branch:add(f.ioa, ioa):set_generated()
	branch:add(f.latitude, octets(0, 4), latitude)
	branch:add(f.longitude, octets(4, 4), longitude)
	branch:add(f.altitude, octets(8, 3), octets(8, 3):le_int() / 10)
	branch:add(f.fix, octets(11, 1))
	branch:add(f.satellites, octets(11, 1))
	for _, bit in ipairs({ f.invalid, f.not_topical, f.substituted, f.blocked, f.overflow }) do
		branch:add(bit, octets(12, 1))
	end
	branch:add(f.time, octets(13, 7), time_of(octets(13, 7)))
	branch:add(f.time_invalid, octets(15, 1))
end

local function asdu(octets, tree)
	local sequence, count = octets(1, 1):bitfield(0, 1) == 1, octets(1, 1):bitfield(1, 7)
	local step = sequence and ELEMENT or ADDRESS + ELEMENT
	if octets:len() ~= HEADER + count * step + (sequence and ADDRESS or 0) then
		tree:add_proto_expert_info(wrong_size)
		return
	end
	for i = 0, count - 1 do
		local at = HEADER + i * step
		local ioa = octets(sequence and HEADER or at, ADDRESS):le_uint() + (sequence and i or 0)
		element(octets(at + ADDRESS, ELEMENT), ioa, tree)
	end
end

-- The length of an APDU counts from its third octet; the ASDU begins at the seventh.
function position.dissector(tvb, _, tree)
	local lengths = { apdus() }
	for _, found in ipairs({ types() }) do
		for _, length in ipairs(lengths) do
			local begin = length.offset + 5
			if found.value == position.prefs.type and begin == found.offset and length.value > 4 + HEADER then
				asdu(tvb(begin, length.value - 4), tree)
			end
		end
	end
end

register_postdissector(position)
