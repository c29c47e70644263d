/**
 * The bytes of a cloud (`GET …/frames/{k}/cloud`) as arrays for the GPU.
 */
import { address, send } from "../app/api.js";

/** {count, total, positions: Float32Array, colours: Uint8Array}; null where the frame has no cloud. */
export async function fetchCloud(scan, frame, most, signal) {
  let response;
  try {
    response = await send(address(`/v1/scans/${scan}/frames/${frame}/cloud`, { max_points: most }), { signal });
  } catch (problem) {
    if (problem.status === 404) return null;
    throw problem;
  }
  const total = Number(response.headers.get("X-Points-Total"));
  const buffer = await response.arrayBuffer();
  const count = buffer.byteLength / 15;
  return {
    count,
    total,
    positions: new Float32Array(buffer, 0, 3 * count),
    colours: new Uint8Array(buffer, 12 * count, 3 * count),
  };
}
