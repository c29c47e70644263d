/**
 * Files and whole folders that were dropped or chosen, with their paths inside the folder.
 */

/** Every file under what was dropped. */
export async function filesOf(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (!entries.length) return [...transfer.files];
  const found = await Promise.all(entries.map((entry) => under(entry, "")));
  return found.flat();
}

async function under(entry, path) {
  if (entry.isFile) {
    const file = await new Promise((resolve, reject) => entry.file(resolve, reject));
    if (path) file.relativeName = path + file.name;
    return [file];
  }
  const found = await Promise.all(
    (await listed(entry.createReader())).map((one) => under(one, `${path}${entry.name}/`)),
  );
  return found.flat();
}

/** A reader gives at most a hundred entries at once. */
async function listed(reader) {
  const all = [];
  for (;;) {
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (!some.length) return all;
    all.push(...some);
  }
}
