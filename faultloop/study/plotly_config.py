"""How plotly's figures behave on every page: nothing on them leads to anybody's cloud."""

CONFIG = {
    "responsive": True,
    "displaylogo": False,
    "scrollZoom": True,
    "showSendToCloud": False,  # no button that would send a record to somebody else's server
    "plotlyServerURL": "",
}
