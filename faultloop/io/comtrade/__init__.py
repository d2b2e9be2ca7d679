"""COMTRADE records (IEC 60255-24): read, select, resample, write."""

from faultloop.io.comtrade.read import read_comtrade
from faultloop.io.comtrade.record import AnalogChannel, Rate, Record, StatusChannel
from faultloop.io.comtrade.resample import resample
from faultloop.io.comtrade.select import Overrides, SixChannels, select_channels
from faultloop.io.comtrade.write import write_comtrade

__all__ = [
    "AnalogChannel",
    "Overrides",
    "Rate",
    "Record",
    "SixChannels",
    "StatusChannel",
    "read_comtrade",
    "resample",
    "select_channels",
    "write_comtrade",
]
