def Peers(options): return []
