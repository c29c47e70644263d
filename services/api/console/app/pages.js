/**
 * The pages by the first part of the address: what the navigation calls them, the file of all and that of a single one.
 */
export const PAGES = {
  plants: { label: "Plants", all: "fleet", one: "plant" },
  scans: { label: "Scans", all: "scans", one: "scan" },
  alarms: { label: "Alarms", all: "alarms" },
  new: { label: "New scan", all: "new" },
  schedules: { label: "Schedules", all: "schedules" },
  webhooks: { label: "Webhooks", all: "webhooks", one: "webhook" },
  admin: { label: "Service", all: "admin" },
};
export const HOME = "plants";

/** The file in `pages/` that shows an address's parts; undefined where there is none. */
export const fileOf = ([name = HOME, id]) => PAGES[name]?.[id ? "one" : "all"];
