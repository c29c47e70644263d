/**
 * NumPy's .npz in the browser: a zip of .npy files. Reads what this service writes: stored or deflated members, little
 * endian numbers and booleans in C order, and strings.
 */
const END = 0x06054b50;
const TAIL = 1 << 16; // the directory of some hundred members
const LOCAL_HEADER = 1024; // more than any that is written here
const READERS = {
  f8: (buffer) => new Float64Array(buffer),
  f4: (buffer) => new Float32Array(buffer),
  i8: (buffer) => Float64Array.from(new BigInt64Array(buffer), Number),
  i4: (buffer) => new Int32Array(buffer),
  u1: (buffer) => new Uint8Array(buffer),
  b1: (buffer) => new Uint8Array(buffer),
};

/** Arrays by name: {shape, values}; `send(path, options)` answers ranges, and only what `names` needs is fetched. */
export async function readNpz(path, send, names) {
  const tail = await send(path, { headers: { Range: `bytes=-${TAIL}` } });
  const end = new DataView(await tail.arrayBuffer());
  const whole = Number(/\/(\d+)$/.exec(tail.headers.get("Content-Range") ?? "")?.[1] ?? end.byteLength);
  const listed = [...members(end, whole - end.byteLength)].filter((member) => !names || names.includes(member.name));
  const found = {};
  for (const member of listed)
    found[member.name] = readNpy(await contentOf(member, await piece(path, send, end, whole, member)));
  return found;
}

/** Names of the files in a zip on this machine. */
export async function namesIn(file) {
  const tail = await file.slice(-TAIL).arrayBuffer();
  return [...members(new DataView(tail), file.size - tail.byteLength)].map((member) => member.path);
}

/** A member with its local header, from the tail where it lies in there. */
async function piece(path, send, tail, whole, { local, size }) {
  const [first, last] = [local, Math.min(whole, local + LOCAL_HEADER + size)];
  const begins = whole - tail.byteLength;
  if (first >= begins) return tail.buffer.slice(first - begins, last - begins);
  return (await send(path, { headers: { Range: `bytes=${first}-${last - 1}` } })).arrayBuffer();
}

/** What the central directory lists; sizes there are right even where the local headers leave them out. */
function* members(view, begins) {
  let end = view.byteLength - 22;
  while (end >= 0 && view.getUint32(end, true) !== END) end--;
  if (end < 0) throw new Error("This is no zip file.");
  let at = view.getUint32(end + 16, true) - begins;
  if (at < 0) throw new Error("This zip file has too many members to be listed here.");
  for (let left = view.getUint16(end + 10, true); left > 0; left--) {
    const [nameLength, extra, comment] = [28, 30, 32].map((offset) => view.getUint16(at + offset, true));
    const path = new TextDecoder().decode(new Uint8Array(view.buffer, at + 46, nameLength));
    yield {
      method: view.getUint16(at + 10, true),
      size: view.getUint32(at + 20, true),
      local: view.getUint32(at + 42, true),
      name: path.replace(/\.npy$/, ""),
      path,
    };
    at += 46 + nameLength + extra + comment;
  }
}

async function contentOf({ method, size }, buffer) {
  const view = new DataView(buffer);
  const start = 30 + view.getUint16(26, true) + view.getUint16(28, true);
  const packed = buffer.slice(start, start + size);
  if (method === 0) return packed;
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"))).arrayBuffer();
}

function readNpy(buffer) {
  const view = new DataView(buffer);
  const isFirst = view.getUint8(6) === 1;
  const length = isFirst ? view.getUint16(8, true) : view.getUint32(8, true);
  const start = (isFirst ? 10 : 12) + length;
  const header = new TextDecoder("latin1").decode(new Uint8Array(buffer, isFirst ? 10 : 12, length));
  const [, order, kind] = /'descr': '([<>|=])(\w+)'/.exec(header);
  const shape = /'shape': \(([^)]*)\)/
    .exec(header)[1]
    .split(",")
    .filter((part) => part.trim())
    .map(Number);
  if (order === ">" || /'fortran_order': True/.test(header))
    throw new Error("This layout of an array is not read here.");
  const content = buffer.slice(start);
  if (kind.startsWith("U")) return { shape, values: strings(content, Number(kind.slice(1))) };
  return { shape, values: READERS[kind](content) };
}

function strings(content, length) {
  const codes = new Uint32Array(content);
  const count = length ? codes.length / length : 0;
  return Array.from({ length: count }, (_, k) =>
    String.fromCodePoint(...codes.subarray(k * length, (k + 1) * length).filter((code) => code !== 0)),
  );
}
