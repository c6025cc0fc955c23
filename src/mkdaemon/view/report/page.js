"use strict";
// Draws the plots of the page: one cursor and one stretch of time for all of them.
(async () => {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  if (!figures.length) {
    document.body.dataset.ready = "yes";
    return;
  }
  const note = document.getElementById("plots-note");
  if (!("DecompressionStream" in window)) {
    note.textContent = "The plots need a browser of 2023 or later.";
    return;
  }
  const packed = Uint8Array.from(atob(document.getElementById("library").textContent), (c) => c.charCodeAt(0));
  const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(unpacked).text();
  document.head.append(script);

  const font = { family: "system-ui, sans-serif", size: 12, color: "#24292f" };
  const axis = { gridcolor: "#e6e9ee", linecolor: "#c9ced6", zerolinecolor: "#c9ced6" };
  const config = { displaylogo: false, responsive: true, scrollZoom: false, modeBarButtonsToRemove: ["lasso2d", "select2d"] };
  const place = (name) => document.getElementById(`plot-${name}`);
  for (const figure of figures) {
    const layout = {
      font, paper_bgcolor: "#fff", plot_bgcolor: "#fff", margin: { l: 76, r: 12, t: 26, b: figure.alone || figure.times.length ? 44 : 28 },
      legend: { orientation: "h", x: 1, xanchor: "right", y: 1.02, yanchor: "bottom" },
      hoverlabel: { namelength: -1 }, showlegend: true, dragmode: "zoom", ...figure.layout,
    };
    layout.xaxis = { ...axis, ...layout.xaxis };
    layout.yaxis = { ...axis, ...layout.yaxis };
    await Plotly.newPlot(place(figure.name), figure.data, layout, config);
  }
  const timed = figures.filter((figure) => !figure.alone && !figure.times.length);
  const tracks = figures.filter((figure) => figure.times.length);

  // The stretch of time that is shown: whoever zooms or pans one plot moves all of them.
  let isFollowing = false;
  const follow = async (source, change) => {
    const wanted = {};
    if (change["xaxis.range[0]"] !== undefined) {
      wanted["xaxis.range"] = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    } else if (change["xaxis.range"] !== undefined) {
      wanted["xaxis.range"] = [...change["xaxis.range"]];
    } else if (change["xaxis.autorange"]) {
      wanted["xaxis.autorange"] = true;
    } else {
      return;
    }
    if (isFollowing) return;
    isFollowing = true;
    await Promise.all(timed.filter((one) => one !== source).map((one) => Plotly.relayout(place(one.name), wanted)));
    isFollowing = false;
  };

  // The moment under the pointer: the same line in every plot, and the place on the tracks.
  const nearest = (times, at) => {
    let low = 0, high = times.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] < at) low = middle + 1; else high = middle;
    }
    return low;
  };
  const show = (at, source) => {
    for (const one of timed) {
      if (one !== source) Plotly.Fx.hover(place(one.name), { xval: at, yval: 0 }, "xy");
    }
    for (const track of tracks) {
      const { x, y } = track.data[0];
      const index = nearest(track.times, at);
      Plotly.restyle(place(track.name), { x: [[x[index]]], y: [[y[index]]] }, [track.data.length - 1]);
    }
  };
  const hide = (source) => {
    for (const one of timed) if (one !== source) Plotly.Fx.unhover(place(one.name));
  };
  let isShowing = false;
  const shown = (at, source) => {
    if (isShowing) return;
    isShowing = true;
    show(at, source);
    isShowing = false;
  };
  for (const one of timed) {
    place(one.name).on("plotly_relayout", (change) => follow(one, change));
    place(one.name).on("plotly_hover", (event) => shown(event.xvals ? event.xvals[0] : event.points[0].x, one));
    place(one.name).on("plotly_unhover", () => { if (!isShowing) { isShowing = true; hide(one); isShowing = false; } });
  }
  for (const track of tracks) {
    place(track.name).on("plotly_hover", (event) => {
      const at = event.points[0].customdata;
      if (at !== undefined) shown(at, track);
    });
  }
  for (const row of document.querySelectorAll("[data-at]")) {
    row.addEventListener("click", () => shown(Number(row.dataset.at), null));
  }

  const resize = (width) => Promise.all(figures.map((one) => Plotly.relayout(place(one.name), width ? { width } : { width: null, autosize: true })));
  window.addEventListener("beforeprint", () => resize(690));
  window.addEventListener("afterprint", () => resize(null));
  note.hidden = true;
  document.body.dataset.ready = "yes";
})();
