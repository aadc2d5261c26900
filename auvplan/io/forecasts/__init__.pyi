from .fetching import Fetched as Fetched
from .fetching import fetch_current as fetch_current
from .request import ForecastError as ForecastError
from .request import Request as Request

__all__ = ["Fetched", "ForecastError", "Request", "fetch_current"]
