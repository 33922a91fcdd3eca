// Figures become interactive when they are visible: the picture of each stays until then, on paper, and where this does not run.
// All that is needed is in this page.
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
  const live = async (figure) => {
    if (figure.dataset.live) return;
    figure.dataset.live = "started";
    const [text] = await Promise.all([unpacked(`live-${figure.dataset.number}`), loaded()]);
    const picture = figure.querySelector("img");
    const box = document.createElement("div");
    box.className = "live";
    box.id = `${figure.id}-live`;
    box.setAttribute("role", "img");
    box.setAttribute("aria-label", picture.alt);
    picture.after(box);
    figure.classList.add("is-live");
    try {
      await Bokeh.embed.embed_item(JSON.parse(text), box.id);
      if (figure.dataset.mark) {
        const mark = document.createElement("strong");
        mark.className = "mark";
        mark.textContent = figure.dataset.mark;
        box.prepend(mark);
      }
    } catch (error) {
      figure.classList.remove("is-live");
      box.remove();
      console.error(error);
    }
  };
  const open = async () => {
    for (const figure of document.querySelectorAll("figure[data-number]")) {
      if (!figure.closest("details:not([open])")) await live(figure);
    }
  };
  if (!document.getElementById("bokeh") || !window.DecompressionStream) return;
  document.querySelectorAll("details").forEach((details) => details.addEventListener("toggle", open));
  const idle = window.requestIdleCallback || ((f) => setTimeout(f, 200));
  addEventListener("load", () => idle(open));
})();
