// Figures become interactive when they are seen: the picture of each stays until then, on paper, and
// where this does not run. All that is needed is in this page.
"use strict";
(() => {
  const unpacked = async (id) => {
    const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  };
  let library = null;
  const loaded = () => library ??= unpacked("bokeh").then((text) => {
    const script = document.createElement("script");
    script.textContent = text;
    document.head.append(script);
    Bokeh.set_log_level("error");
  });
  const made = (tag, name, text) => {
    const element = document.createElement(tag);
    element.className = name;
    if (text) element.textContent = text;
    return element;
  };
  const SHAPES = {
    circle: "<circle cx='14' cy='7' r='4'/>", square: "<path d='M10 3h8v8h-8z'/>", diamond: "<path d='M14 1l3.3 6-3.3 6-3.3-6z'/>",
    triangle: "<path d='M14 2l5 9h-10z'/>", inverted_triangle: "<path d='M14 12l5-9h-10z'/>", hex: "<path d='M9 7l2.5-4.5h5l2.5 4.5-2.5 4.5h-5z'/>",
    star: "<path d='M14 1l1.8 4h4l-3.2 2.6 1.2 4.2-3.8-2.5-3.8 2.5 1.2-4.2-3.2-2.6h4z'/>", dash: "<path d='M9 7h10'/>",
    square_pin: "<path d='M9.5 2.5q4.5 3 9 0-3 4.5 0 9-4.5-3-9 0 3-4.5 0-9z'/>", bar: "<path d='M14 1v12m-4-6h8'/>",
    triangle_dot: "<path d='M14 2l5 9h-10z'/><circle cx='14' cy='8' r='.5'/>", square_dot: "<path d='M10 3h8v8h-8z'/><circle cx='14' cy='7' r='.5'/>",
    x: "<path d='M10 3l8 8m0-8l-8 8'/>", cross: "<path d='M14 2v10m-5-5h10'/>",
  };
  const DASHES = { dashed: "6 4", dotted: "2 3", dashdot: "6 3 2 3" };
  const swatch = (entry) => {
    const found = made("span", "swatch");
    const line = entry.dash ? `<path d='M0 7h28' stroke-dasharray='${DASHES[entry.dash] || ""}'/>` : "";
    const shape = SHAPES[entry.marker] || "";
    found.innerHTML = `<svg width='28' height='14' aria-hidden='true' stroke='${entry.colour}' stroke-width='2' fill='${entry.fill || "none"}'>${line}${shape}</svg>`;
    return found;
  };
  const controls = (figure, legend, roots) => {
    const box = made("div", "legend");
    const off = new Set();
    const shown = () => {
      for (const root of roots) {
        for (const model of [...root.renderers, ...root.center]) {
          if (model.tags.length) model.visible = !model.tags.some((tag) => off.has(tag));
        }
      }
    };
    legend.forEach((entry, number) => {
      const item = made(entry.switches ? "button" : "span", "entry");
      item.append(swatch(entry), entry.label);
      if (entry.switches) {
        item.type = "button";
        item.setAttribute("aria-pressed", "true");
        item.addEventListener("click", () => {
          if (!off.delete(number)) off.add(number);
          item.setAttribute("aria-pressed", String(!off.has(number)));
          shown();
        });
      }
      box.append(item);
    });
    const whole = made("button", "whole", "Whole range");
    whole.type = "button";
    whole.addEventListener("click", () => roots.forEach((root) => root.reset.emit()));
    if (figure.dataset.mark) box.prepend(made("strong", "mark", figure.dataset.mark));
    box.append(whole, made("span", "hint", matchMedia("(pointer: coarse)").matches
      ? "Tap a point to read it off." : "Drag: zoom. Ctrl and wheel: zoom. Point: values."));
    return box;
  };
  const live = async (figure) => {
    if (figure.dataset.live) return;
    figure.dataset.live = "begun";
    const [text] = await Promise.all([unpacked(`live-${figure.dataset.number}`), loaded()]);
    const found = JSON.parse(text);
    const box = made("div", "live");
    const grid = made("div", "panels");
    grid.setAttribute("role", "img");
    grid.setAttribute("aria-label", figure.querySelector("img").alt);
    grid.style.setProperty("--columns", found.columns.map((width) => `minmax(0, ${width}fr)`).join(" "));
    const places = {};
    for (const panel of found.panels) {
      const place = made("div", "panel");
      place.id = `${figure.id}-${panel.root}`;
      place.style.setProperty("--row", `${panel.row} / span ${panel.rows}`);
      place.style.setProperty("--column", `${panel.column} / span ${panel.columns}`);
      places[panel.root] = place.id;
      grid.append(place);
    }
    box.append(grid);
    figure.querySelector("img").after(box);
    figure.classList.add("is-live");
    try {
      const before = Bokeh.documents.length;
      const item = { docid: figure.id, roots: places, root_ids: found.panels.map((panel) => panel.root) };
      await Bokeh.embed.embed_items({ [figure.id]: found.document }, [item]);
      const roots = Bokeh.documents[before].roots();
      if (matchMedia("(pointer: coarse)").matches) {
        // a finger that moves over a figure moves the page
        roots.forEach((root) => { root.toolbar.active_drag = null; root.toolbar.gestures.pan.active = null; });
      }
      box.prepend(controls(figure, found.legend, roots));
    } catch (error) {
      figure.classList.remove("is-live");
      box.remove();
      console.error(error);
    }
  };
  const all = async (figures) => { for (const figure of figures) await live(figure); };
  const open = () => all([...document.querySelectorAll("figure[data-number]")].filter((f) => !f.closest("details:not([open])")));
  if (!document.getElementById("bokeh") || !window.DecompressionStream) return;
  document.querySelectorAll("details").forEach((details) => details.addEventListener("toggle", open));
  const idle = window.requestIdleCallback || ((f) => setTimeout(f, 200));
  addEventListener("load", () => idle(open));
})();
