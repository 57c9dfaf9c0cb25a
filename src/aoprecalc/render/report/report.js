/* The script of the report page. page.html.j2 lists the ids and attributes that it works with. */
(() => {
  "use strict";
  const root = document.documentElement;
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  root.classList.add("js");

  // Light and dark: as the system has it, until the reader chooses.
  const remembered = {
    get() { try { return localStorage.getItem("aoprecalc-theme"); } catch { return null; } },
    set(theme) { try { localStorage.setItem("aoprecalc-theme", theme); } catch { /* files may have no storage */ } },
  };
  const prefersDark = matchMedia("(prefers-color-scheme: dark)");
  const theme = () => root.dataset.theme ?? (prefersDark.matches ? "dark" : "light");
  if (["light", "dark"].includes(remembered.get())) root.dataset.theme = remembered.get();

  function setUpTheme() {
    const button = document.getElementById("theme");
    const label = () => { button.textContent = theme() === "dark" ? "Light" : "Dark"; };
    button.hidden = false;
    button.addEventListener("click", () => {
      root.dataset.theme = theme() === "dark" ? "light" : "dark";
      remembered.set(root.dataset.theme);
      label();
    });
    prefersDark.addEventListener("change", label);
    label();
  }

  // The table: search, filters, order.
  function setUpTable() {
    const table = document.getElementById("assets");
    if (!table) return;
    const body = table.tBodies[0], rows = [...body.rows];
    const search = document.getElementById("search"), filters = all("button[data-filter]");
    const texts = new Map(rows.map((row) => [row, row.textContent.toLowerCase().replace(/\s+/g, " ")]));
    let filter = "all";
    const passes = {
      all: () => true,
      failed: (row) => ["failed", "stopped", "unreadable"].includes(row.dataset.status),
      warnings: (row) => Number(row.dataset.warnings) > 0,
    };
    const show = () => {
      const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
      const wanted = passes[filter] ?? ((row) => row.dataset.change === filter);
      let shown = 0;
      for (const row of rows) {
        row.hidden = !(wanted(row) && words.every((word) => texts.get(row).includes(word)));
        shown += row.hidden ? 0 : 1;
      }
      document.getElementById("shown").textContent = `${shown} of ${rows.length} shown`;
      document.getElementById("nothing").hidden = shown > 0;
    };
    search.addEventListener("input", show);
    for (const button of filters) {
      button.addEventListener("click", () => {
        filter = button.dataset.filter;
        for (const other of filters) other.setAttribute("aria-pressed", String(other === button));
        show();
      });
    }

    const collator = new Intl.Collator(undefined, { numeric: true });
    const value = (row, key) => row.querySelector(`[data-key="${key}"]`).dataset.value;
    for (const header of all("thead th[data-column]", table)) {
      const key = header.dataset.column, button = document.createElement("button");
      button.type = "button";
      button.dataset.key = key;
      button.append(...header.childNodes);
      header.append(button);
      button.addEventListener("click", () => {
        const first = header.classList.contains("number") ? "descending" : "ascending";
        const other = first === "ascending" ? "descending" : "ascending";
        const order = header.getAttribute("aria-sort") === first ? other : first;
        for (const heading of all("thead th", table)) heading.removeAttribute("aria-sort");
        header.setAttribute("aria-sort", order);
        const sign = order === "ascending" ? 1 : -1;
        const sorted = rows.toSorted((a, b) => {
          const [one, two] = [value(a, key), value(b, key)];
          if ((one === "") !== (two === "")) return one === "" ? 1 : -1;  // what has no value comes last
          return sign * (key === "name" ? collator.compare(one, two) : Number(one) - Number(two));
        });
        body.append(...sorted);
      });
    }
    body.addEventListener("click", (event) => {
      const row = event.target.closest("tr");
      if (!event.target.closest("a") && !getSelection().toString()) location.hash = row.dataset.asset;
    });
    show();
  }

  // One asset is open at a time, and with it the only 3D view: browsers limit their number.
  let live = null;

  function closeView() {
    if (!live) return;
    live.view?.dispose();
    const canvas = live.holder.querySelector("canvas");
    canvas.replaceWith(Object.assign(document.createElement("canvas"), { hidden: true }));  // it takes no other view
    live.holder.dataset.state = "closed";
    live = null;
  }

  const MODES = { ao: "ambient occlusion", material: "material", spheres: "spheres", checker: "UV checker", error: "error" };

  function press(holder, mode) {
    for (const button of all("button[data-mode]", holder)) {
      button.setAttribute("aria-pressed", String(button.dataset.mode === mode));
    }
  }

  function showStills(holder, reason) {
    const stills = all("img[data-still]", holder), modes = stills.map((still) => still.dataset.still);
    holder.dataset.state = "stills";
    const canvas = holder.querySelector("canvas");
    if (canvas) canvas.hidden = true;
    for (const button of all("button[data-mode]", holder)) button.hidden = !modes.includes(button.dataset.mode);
    for (const still of stills) still.hidden = still !== stills[0];
    press(holder, modes[0]);
    holder.querySelector("[data-view-note]").textContent = reason;
  }

  function openView(section) {
    closeView();
    const holder = section.querySelector("[data-view]");
    if (!holder) return;
    const note = holder.querySelector("[data-view-note]"), data = document.getElementById(`${section.id}-view`);
    if (!data) return showStills(holder, note.textContent);
    if (typeof AoView === "undefined") return showStills(holder, "Still pictures: the 3D view did not start.");
    const address = (picture) => section.querySelector(`[data-picture="${picture}"] img`)?.src ?? null;
    const asset = JSON.parse(data.textContent);
    asset.textures = { ...asset.textures, ao: address("texture"), error: address("error") };
    const canvas = holder.querySelector("canvas");
    const fail = (error) => {
      if (live?.holder !== holder) return;
      closeView();
      showStills(holder, `Still pictures: the 3D view cannot be drawn (${error.message}).`);
    };
    holder.dataset.state = "loading";
    canvas.hidden = false;
    live = { holder, view: null };
    try {
      live.view = new AoView.MeshView(canvas, asset, { onerror: fail });
    } catch (error) {
      return fail(error);
    }
    const mine = live;
    mine.view.ready.then(() => {
      if (live !== mine) return;
      holder.dataset.state = "live";
      for (const still of all("img[data-still]", holder)) still.hidden = true;
      for (const button of all("button[data-mode]", holder)) button.hidden = !mine.view.modes.includes(button.dataset.mode);
      press(holder, mine.view.modes[0]);
      note.textContent = asset.note;
    }, fail);
  }

  function setUpViews() {
    for (const holder of all("[data-view]")) {
      for (const button of all("button[data-mode]", holder)) {
        button.addEventListener("click", () => {
          const mode = button.dataset.mode;
          press(holder, mode);
          if (live?.holder === holder && live.view) live.view.setMode(mode);
          else for (const still of all("img[data-still]", holder)) still.hidden = still.dataset.still !== mode;
        });
      }
    }
  }

  // Which asset is open stands behind the # of the address.
  function setUpPages() {
    const sections = all("section.asset"), overview = document.getElementById("overview");
    const go = (focus) => {
      const wanted = sections.find((section) => `#${section.id}` === location.hash);
      const open = wanted ?? (overview ? null : sections[0]);
      for (const section of sections) section.toggleAttribute("data-open", section === open);
      if (overview) overview.hidden = Boolean(open);
      closeView();
      if (open) openView(open);
      if (focus) {
        scrollTo(0, 0);
        document.getElementById(open ? `${open.id}-title` : "overview-title")?.focus({ preventScroll: true });
      }
    };
    addEventListener("hashchange", () => { if (location.hash !== "#main") go(true); });
    go(false);
  }

  function setUpSliders() {
    for (const slider of all("[data-slider]")) {
      const range = slider.querySelector("input");
      const move = () => slider.style.setProperty("--at", `${range.value}%`);
      range.addEventListener("input", move);
      move();
    }
  }

  function setUpCopying() {
    if (!navigator.clipboard) return;
    for (const button of all("button[data-copy]")) {
      button.hidden = false;
      button.addEventListener("click", async () => {
        try {
          await navigator.clipboard.writeText(button.parentElement.querySelector("code").textContent);
          button.textContent = "Copied";
        } catch {
          button.textContent = "Not allowed";
        }
        setTimeout(() => { button.textContent = "Copy"; }, 2000);
      });
    }
  }

  addEventListener("DOMContentLoaded", () => {
    setUpTheme();
    setUpTable();
    setUpSliders();
    setUpViews();
    setUpCopying();
    setUpPages();
  });
})();
