"""Plant, relays and breakers as processes of their own on one bus, in real time.

They share nothing but frames (and, started by one supervisor, the instant at which time zero is).
"""
