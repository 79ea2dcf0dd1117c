// SPDX-License-Identifier: GPL-3.0-or-later
// A server of npm's packages on a port of 127.0.0.1: maker, port, first address, unit.
// Each line of its input is a command, [name, ...arguments]; each line of its output answers one.
"use strict";
const net = require("node:net");
const readline = require("node:readline");
const { createRequire } = require("node:module");

const [folder, maker, port, first, unit] = process.argv.slice(2);
const packages = createRequire(`${folder}/`);
const SIZE = 65536;
const FIRST = Number(first);
const MBAP = 7;
const ILLEGAL_ADDRESS = 2;

const tables = { coils: [], discrete_inputs: [], input_registers: [], holding_registers: [] };
const requests = [];
for (const values of Object.values(tables)) values.push(...new Array(SIZE).fill(0));

// Each request before it is answered.
function listen(socket) {
  let octets = Buffer.alloc(0);
  socket.prependListener("data", (more) => {
    octets = Buffer.concat([octets, more]);
    while (octets.length >= MBAP && octets.length >= MBAP - 1 + octets.readUInt16BE(4)) {
      const end = MBAP - 1 + octets.readUInt16BE(4);
      requests.push(octets.subarray(MBAP, end).toString("hex"));
      octets = octets.subarray(end);
    }
  });
}

function modbusSerial() {
  const ServerTCP = packages("modbus-serial/servers/servertcp");
  const at = (table, address) => {
    if (address < FIRST) throw { modbusErrorCode: ILLEGAL_ADDRESS };
    return tables[table][address];
  };
  const put = (table, address, value) => {
    at(table, address);
    tables[table][address] = Number(value);
  };
  const vector = {
    getCoil: (address) => at("coils", address),
    getDiscreteInput: (address) => at("discrete_inputs", address),
    getInputRegister: (address) => at("input_registers", address),
    getHoldingRegister: (address) => at("holding_registers", address),
    setCoil: (address, value) => put("coils", address, value),
    setRegister: (address, value) => put("holding_registers", address, value),
  };
  const server = new ServerTCP(vector, { host: "127.0.0.1", port: Number(port), unitID: Number(unit) });
  server._server.prependListener("connection", listen);
  server.on("initialized", () => console.log(JSON.stringify("listening")));
}

// It has buffers of all addresses, and knows no unit.
const buffers = { coils: Buffer.alloc(SIZE / 8), holding: Buffer.alloc(2 * SIZE) };

function jsmodbus() {
  const { ModbusTCPServer } = packages("jsmodbus");
  const server = net.createServer();
  server.on("connection", listen);
  new ModbusTCPServer(server, { ...buffers, discrete: buffers.coils, input: buffers.holding });
  server.listen(Number(port), "127.0.0.1", () => console.log(JSON.stringify("listening")));
}

const commands = {
  get: (table, address, count) => tables[table].slice(address, address + count),
  set: (table, address, values) => {
    values.forEach((value, place) => {
      tables[table][address + place] = value;
    });
  },
  register: (address, value) => {
    buffers.holding.writeUInt16BE(value, 2 * address);
  },
  requests: (known) => requests.slice(known),
};

({ "modbus-serial": modbusSerial, jsmodbus })[maker]();
readline.createInterface({ input: process.stdin }).on("line", (line) => {
  const [name, ...rest] = JSON.parse(line);
  console.log(JSON.stringify(commands[name](...rest) ?? null));
});
