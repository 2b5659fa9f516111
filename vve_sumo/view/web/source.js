// Where the page's data comes from: the server's files beside the page, or the page itself where it is one file.

const embedded = document.getElementById("vve-data");
const held = embedded ? JSON.parse(embedded.textContent) : null;

function decoded(text) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let at = 0; at < binary.length; at += 1) bytes[at] = binary.charCodeAt(at);
  return bytes;
}

async function fetched(name) {
  const answer = await fetch(new URL(name, document.baseURI));
  if (!answer.ok) throw new Error((await answer.text()).slice(0, 500) || `${name}: ${answer.status}`);
  return answer;
}

/** What the page is to show: { kind: "drive" | "sweep" | "live", records: [key, ...] }. */
export async function readContents() {
  return held ? held.contents : (await fetched(`contents.json${location.search}`)).json();
}

/** A record: { scene, frames, details }, the last a promise. */
export async function readRecord(key) {
  if (held) {
    const own = held.records[key];
    return { scene: own.scene, frames: decoded(own.frames), details: own.details ? Promise.resolve(decoded(own.details)) : null };
  }
  const folder = `record/${encodeURIComponent(key)}`;
  const [scene, frames] = await Promise.all([
    fetched(`${folder}/scene.json`).then((answer) => answer.json()),
    fetched(`${folder}/frames.bin`).then((answer) => answer.arrayBuffer()),
  ]);
  const details = fetched(`${folder}/details.bin`).then((answer) => answer.arrayBuffer());
  return { scene, frames, details };
}

/** The columns of a sweep, packed. */
export async function readSweep() {
  return held ? decoded(held.sweep) : (await fetched("sweep.bin")).arrayBuffer();
}
