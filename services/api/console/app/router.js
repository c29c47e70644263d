/**
 * Where the page is: the address behind `#`, as path parts and a query. Back and forward work as everywhere.
 */
import { useEffect, useState } from "./html.js";

/** The present place: `#/scans/ID/modes?organ=leaf_0` → parts ["scans", "ID", "modes"], query {organ: "leaf_0"}. */
export function place(hash = location.hash) {
  const [path, query = ""] = hash.replace(/^#\/?/, "").split("?");
  return { parts: path.split("/").filter(Boolean).map(decodeURIComponent), query: new URLSearchParams(query) };
}

/** The address of a place. */
export function to(parts, query = {}) {
  const path = parts.map(encodeURIComponent).join("/");
  const words = new URLSearchParams(Object.entries(query).filter(([, value]) => value !== "" && value != null));
  return `#/${path}${words.size ? `?${words}` : ""}`;
}

export const go = (href) => (location.hash = href);

/** Change the query of the present place without a new entry in the history. */
export function requery(changes) {
  const { parts, query } = place();
  history.replaceState(null, "", to(parts, { ...Object.fromEntries(query), ...changes }));
  window.dispatchEvent(new HashChangeEvent("hashchange"));
}

/** The place, and a new drawing whenever it changes. */
export function usePlace() {
  const [here, setHere] = useState(() => place());
  useEffect(() => {
    const onChange = () => setHere(place());
    window.addEventListener("hashchange", onChange);
    return () => window.removeEventListener("hashchange", onChange);
  }, []);
  return here;
}
